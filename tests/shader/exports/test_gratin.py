"""Gratin's file: the same elements, in the same order, as in one that Gratin has loaded; and its parameters."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from harness.scene import Scene, load_scene
from harness.shader.exports import export
from harness.shader.exports.gratin import SLIDER, Parameter
from tests.support.exported import drawn, named, rendered, value

ROOT = Path(__file__).parents[3]
SCENES = ROOT / "mitsuba_scenes"
# Loads and computes in Gratin 0.3.1 itself.
KNOWN = ROOT / "tests/examples/two_nodes.gra"
# What a node with parameters has besides: as Gratin saves them.
WIDGETS = ("genericWidget", "childWidget")


def pipeline(scene: Scene) -> str:
    return str(export(scene, "mixture", "gratin")[f"{scene.name}.gra"])


def elements(data: ElementTree.Element) -> Iterator[tuple[str, str, str]]:
    """Tag, name and attributes of every element but a parameter's, in order."""
    for child in data:
        name = child.get("name", "")
        if not name.startswith(WIDGETS):
            yield child.tag, name, " ".join(child.attrib)
            yield from elements(child)


def test_it_has_the_elements_of_a_file_that_gratin_loads() -> None:
    ours = ElementTree.fromstring(pipeline(load_scene(SCENES / "spheres.xml")))
    known = ElementTree.parse(KNOWN).getroot()
    assert ours.attrib == known.attrib
    assert list(elements(ours)) == list(elements(known))


def test_what_is_no_shader_has_the_values_of_that_file() -> None:
    """But for the nodes' size, passes and parameters."""
    own = {"genericFragBody", "genericVertBody", "pingPongNumber", "genericNbWidgets", "nbChildren", "0", "1"}
    ours, known = (
        [(one.get("name"), one.get("val")) for one in root.iter()
         if one.get("val") is not None and one.get("name") not in own and not one.get("name", "").startswith(
             (*WIDGETS, "floatAttrib", "currentVal", "nbCurves", "interpType", "leftType", "rightType", "nbPoints",
              "nbTangents"))]
        for root in (ElementTree.fromstring(pipeline(load_scene(SCENES / "spheres.xml"))),
                     ElementTree.parse(KNOWN).getroot()))
    assert ours == known


def test_the_lens_and_the_exponents_are_parameters() -> None:
    graph = ElementTree.fromstring(pipeline(load_scene(SCENES / "depth_of_field.xml")))
    node, widgets = named(graph, "node-0"), named(graph, "nodeWidget-0")
    names = [value(node, f"genericWidgetName-{index}") for index in range(int(value(node, "genericNbWidgets")))]
    values = [float(value(named(widgets, f"childWidget-{index}"), "currentVal")) for index in range(len(names))]
    found = dict(zip(names, values, strict=True))
    assert found == {"aperture": 0.22, "focal_distance": 7.0, "exponent_near": 30.0, "exponent_in_focus": 60.0,
                     "exponent_far": 15.0}
    body = value(node, "genericFragBody")
    assert not any(f"uniform float {name}" in body for name in names), "Gratin writes the head"
    assert value(named(graph, "node-1"), "genericWidgetName-0") == "exposure"


@pytest.mark.parametrize("number", [0.0, 0.22, 7.0, 1e-3, 200.0, float(np.float32(1 / 3))])
def test_a_slider_keeps_the_value_to_the_bit(number: float) -> None:
    """As Gratin's slider computes: a whole step of a thousand from the least to the greatest, in float32."""
    made = Parameter.around("a", number)
    low, high, asked = (np.float32(one) for one in (made.lowest, made.highest, made.value))
    step = int((asked - low) / (high - low) * np.float32(1000))
    assert np.float32(step) / np.float32(1000) * (high - low) + low == asked
    assert made.view == SLIDER


def test_turning_a_parameter_changes_what_the_scene_has_there(tmp_path: Path) -> None:
    """An exponent that is turned is the exponent of that material, and of no other."""
    text = pipeline(load_scene(SCENES / "depth_of_field.xml", width=16, height=12))
    assert text.count('name="currentVal" val="60"') == 1
    turned = {"depth_of_field.gra": text.replace('name="currentVal" val="60"', 'name="currentVal" val="7"')}
    scene = load_scene(SCENES / "depth_of_field.xml", width=16, height=12)
    other = (SCENES / "depth_of_field.xml").read_text()
    assert other.count('name="alpha" value="60"') == 1
    path = tmp_path / "turned.xml"
    path.write_text(other.replace('name="alpha" value="60"', 'name="alpha" value="7"'))
    expected = rendered(load_scene(path, width=16, height=12), "mixture", 8)
    np.testing.assert_array_equal(drawn("gratin", turned, scene, 2), expected)


def test_shapes_of_one_name_have_parameters_of_their_own() -> None:
    scene = load_scene(SCENES / "depth_of_field.xml")
    shapes = tuple(dataclasses.replace(shape, name="a  ball!") for shape in scene.shapes)
    alike = dataclasses.replace(scene, shapes=shapes)
    text = pipeline(alike)
    for name in ("exponent_a_ball", "exponent_a_ball_2", "exponent_a_ball_3"):
        assert f'val="{name}"' in text


def test_images_are_inputs() -> None:
    """Which wait for nodes that load them; the comment says which goes where."""
    graph = ElementTree.fromstring(pipeline(load_scene(SCENES / "textures.xml")))
    assert [value(graph, f"nodeInputName-0-{index}") for index in range(int(value(graph, "nodeInputNameSize-0")))] == [
        "inBuffer0", "inBuffer1", "inBuffer2", "inBuffer3"]
    assert "inBuffer1 for tiles.png" in value(named(graph, "node-0"), "genericFragBody")
