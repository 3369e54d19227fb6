"""What the loader reads: the same as Mitsuba makes of the file, defaults included; and a hash of the content alone."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.reference.phong import DEFAULTS
from harness.scene import Material, Scene, SceneFile, describe, load_scene, present

SCENES = sorted(path for pattern in ("*.xml", "traps/*.xml")
                for path in (Path(__file__).parents[2] / "mitsuba_scenes").glob(pattern))


def only_shape(scene: Scene) -> Any:
    """The one shape of a scene."""
    (shape,) = scene.shapes
    return shape


@pytest.mark.parametrize("transform", [
    '<scale x="2" y="3" z="0.5"/>',
    '<rotate x="1" angle="30"/><translate x="1" y="2" z="3"/>',
    '<translate x="1" y="2" z="3"/><rotate z="1" angle="-70"/><scale value="2"/><rotate y="1" angle="10"/>',
    '<matrix value="1 0.2 0 3  0 2 0.1 4  0.3 0 1.5 5  0 0 0 1"/>',
    '<matrix value="1 2 3 4 5 6 7 8 0"/>',
    '<lookat origin="1, 2, 3" target="0, 1, -1" up="0, 1, 0.3"/>',
])
def test_transforms_compose_as_in_mitsuba(mi: Any, write: Any, transform: str) -> None:
    """First in the file is applied first; the plane's corners land where Mitsuba's mesh of it has them."""
    path = write(f'<shape type="rectangle"><transform name="to_world">{transform}</transform></shape>')
    shape = only_shape(load_scene(path))
    bounds = mi.load_file(str(path)).shapes()[0].bbox()
    corners = np.array([[x, y, 0, 1] for x in (-1, 1) for y in (-1, 1)]) @ shape.matrix.T
    np.testing.assert_allclose(corners[:, :3].min(axis=0), np.ravel(bounds.min), rtol=2e-6, atol=2e-6)
    np.testing.assert_allclose(corners[:, :3].max(axis=0), np.ravel(bounds.max), rtol=2e-6, atol=2e-6)


def test_center_and_radius_come_before_the_transform(mi: Any, write: Any) -> None:
    """A sphere's own place is in its object space."""
    path = write('<shape type="sphere"><point name="center" x="1" y="2" z="3"/><float name="radius" value="0.5"/>'
                 '<transform name="to_world"><scale value="3"/><translate x="-1"/></transform></shape>')
    shape = only_shape(load_scene(path))
    bounds = mi.load_file(str(path)).shapes()[0].bbox()
    np.testing.assert_allclose(shape.matrix[:3, 3], (np.ravel(bounds.min) + np.ravel(bounds.max)) / 2, rtol=1e-6)
    np.testing.assert_allclose(np.diag(shape.matrix)[:3], (np.ravel(bounds.max) - np.ravel(bounds.min)) / 2, rtol=1e-6)


@pytest.mark.parametrize("emits", [False, True])
def test_a_shape_without_bsdf_gets_mitsubas(mi: Any, write: Any, emits: bool) -> None:
    """Grey 0.5, and black for an emitter."""
    emitter = '<emitter type="area"/>' if emits else ""
    path = write(f'<shape type="sphere">{emitter}</shape>')
    reflectance = mi.traverse(mi.load_file(str(path)).shapes()[0].bsdf())["reflectance.value"]
    assert only_shape(load_scene(path)).material == Material((float(np.ravel(reflectance)[0]),) * 3, (0, 0, 0), 1.0)


@pytest.mark.parametrize("given", ["", '<float name="radiance" value="2"/>', '<integer name="radiance" value="3"/>',
                                   '<rgb name="radiance" value="1, 2, 4"/>', '<rgb name="radiance" value="2.5"/>'])
def test_radiance_is_that_of_mitsuba(mi: Any, write: Any, given: str) -> None:
    """Of an area light and of the sky, by default and however it is given."""
    path = write(f'<shape type="sphere"><transform name="to_world"><translate z="5"/></transform>'
                 f'<emitter type="area">{given}</emitter></shape><emitter type="constant">{given}</emitter>')
    scene, theirs = load_scene(path), mi.load_file(str(path))
    hit = theirs.ray_intersect(mi.Ray3f([0, 0, 0], [0, 0, 1]))
    assert only_shape(scene).emission == tuple(np.ravel(hit.emitter(theirs).eval(hit)).tolist())
    assert scene.environment == tuple(np.ravel(theirs.environment().eval(hit)).tolist())


@pytest.mark.parametrize("given", ["", '<float name="{0}" value="0.25"/>', '<integer name="{0}" value="1"/>',
                                   '<rgb name="{0}" value="0.25, 0.5, 0.75"/>', '<rgb name="{0}" value="0.5"/>',
                                   '<spectrum name="{0}" value="0.25"/>'])
@pytest.mark.parametrize(("bsdf", "name"), [("diffuse", "reflectance"), ("phong", "kd"), ("phong", "ks")])
def test_reflectances_are_those_of_mitsuba(mi: Any, write: Any, bsdf: str, name: str, given: str) -> None:
    """By default, as a number, a colour, or a uniform spectrum."""
    path = write(f'<shape type="sphere"><bsdf type="{bsdf}">{given.format(name)}</bsdf></shape>')
    material = only_shape(load_scene(path)).material
    theirs = mi.traverse(mi.load_file(str(path)).shapes()[0].bsdf())[f"{name}.value"]
    expected = tuple(np.broadcast_to(np.ravel(theirs), 3).tolist())
    assert (material.ks if name == "ks" else material.kd) == expected


def test_phong_defaults_are_those_of_the_reference_plugin(write: Any) -> None:
    """The loader and the plugin each hold them; neither imports the other."""
    material = only_shape(load_scene(write('<shape type="sphere"><bsdf type="phong"/></shape>'))).material
    assert material == Material((DEFAULTS["kd"],) * 3, (DEFAULTS["ks"],) * 3, DEFAULTS["alpha"])


def test_film_and_camera_defaults_are_those_of_mitsuba(mi: Any, write: Any) -> None:
    """Size of the film, clip distances; the field of view is compared in the camera's tests."""
    for element in ('<sensor type="perspective"/>', '<sensor type="perspective"><film type="hdrfilm"/></sensor>'):
        path = write(sensor=element)
        scene, theirs = load_scene(path), mi.load_file(str(path)).sensors()[0]
        assert [scene.width, scene.height] == np.ravel(theirs.film().size()).tolist()
        assert np.float32([scene.camera.near_clip, scene.camera.far_clip]).tolist() == [
            theirs.near_clip(), theirs.far_clip()]
        shown = present(scene.file)
        assert shown.exposure == 0
        assert len(shown.notes) == 1 and re.search("box filter|by box", shown.notes[0])


def test_twosided_shades_both_sides(write: Any) -> None:
    """The nested BSDF with a mark; on its own it is one-sided."""
    nested = '<bsdf type="phong"><float name="kd" value="0.3"/><float name="ks" value="0.2"/></bsdf>'
    plain = only_shape(load_scene(write(f'<shape type="disk">{nested}</shape>'))).material
    both = only_shape(load_scene(write(f'<shape type="disk"><bsdf type="twosided">{nested}</bsdf></shape>'))).material
    assert not plain.two_sided
    assert both == dataclasses.replace(plain, two_sided=True)


def test_bsdfs_may_be_referenced_from_anywhere(write: Any) -> None:
    """Before or after the shape, through an alias, inside `twosided`, and from an included file."""
    write("", sensor="", integrator="", name="part.xml").write_text(
        '<scene version="3.0.0"><bsdf type="diffuse" id="red"><rgb name="reflectance" value="1, 0, 0"/></bsdf></scene>')
    scene = load_scene(write(
        '<include filename="part.xml"/><shape type="sphere"><ref id="late"/></shape>'
        '<shape type="disk"><bsdf type="twosided"><ref id="red"/></bsdf></shape>'
        '<alias id="red" as="rouge"/><shape type="cube"><ref id="rouge"/></shape>'
        '<bsdf type="diffuse" id="late"><float name="reflectance" value="0.25"/></bsdf>'))
    assert [shape.material.kd for shape in scene.shapes] == [(0.25, 0.25, 0.25), (1, 0, 0), (1, 0, 0)]
    assert [shape.material.two_sided for shape in scene.shapes] == [False, True, False]


def test_default_parameters_are_filled_in(write: Any) -> None:
    """`<default>` gives `$name` its value."""
    scene = load_scene(write('<default name="size" value="0.25"/><shape type="sphere" id="$size">'
                             '<float name="radius" value="$size"/></shape>'))
    assert only_shape(scene).matrix[0, 0] == 0.25


def test_names_and_file_order_are_kept(write: Any) -> None:
    """A shape's id is its name; one without has none."""
    scene = load_scene(write('<shape type="cube" id="b"/><shape type="sphere"/><shape type="disk" id="a Ω"/>'))
    assert [(shape.kind, shape.name) for shape in scene.shapes] == [("cube", "b"), ("sphere", ""), ("disk", "a Ω")]
    assert scene.name == "scene" and scene.path is not None and scene.path.is_absolute()


@pytest.mark.parametrize(("element", "note"), [
    ('<film type="hdrfilm"><rfilter type="gaussian"><float name="stddev" value="0.4"/></rfilter></film>', "'gaussian'"),
    ('<film type="hdrfilm"><rfilter type="mitchell"/></film>', "'mitchell' replaced by box in both renderers"),
    ('<film type="hdrfilm"><rfilter type="box"/></film><sampler type="stratified"/>', "sampler 'stratified' replaced"),
])
def test_what_is_replaced_is_said(write: Any, element: str, note: str) -> None:
    """Filters and samplers that both renderers do without leave a note."""
    found, = present(SceneFile(write(sensor=f'<sensor type="perspective">{element}</sensor>'))).notes
    assert note in found


def test_a_size_asked_for_replaces_the_films(write: Any) -> None:
    """One or both sides; the field of view stays on its axis."""
    path = write(sensor='<sensor type="perspective"><float name="fov" value="60"/><string name="fov_axis" value="y"/>'
                        '<film type="hdrfilm"><rfilter type="box"/></film></sensor>')
    scene = load_scene(path, width=100, height=50)
    assert (scene.width, scene.height) == (100, 50)
    assert scene.camera.tan_y == pytest.approx(np.tan(np.radians(30))) == pytest.approx(scene.camera.tan_x / 2)
    assert load_scene(path, width=10).height == 576


def test_description_is_the_opening_comment(tmp_path: Path) -> None:
    """As one paragraph; with or without an XML declaration; empty where there is none."""
    path = tmp_path / "scene.xml"
    for text, expected in (("<!-- A box,\n     lit from above. --><scene/>", "A box, lit from above."),
                           ('<?xml version="1.0"?>\n<!--One.--><!--Two.--><scene/>', "One."),
                           ("<scene><!-- inside --></scene>", "")):
        path.write_text(text)
        assert describe(path) == expected


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_shipped_scenes_say_what_they_prove(path: Path) -> None:
    """Each loads without a note, and opens with a comment that says what it proves."""
    scene = load_scene(path)
    assert present(scene.file).notes == ()
    assert "prove" in describe(path)


HASHED = ('<shape type="sphere" id="ball"><float name="radius" value="0.5"/><bsdf type="phong">'
          '<float name="kd" value="0.2"/><float name="ks" value="0.3"/><float name="alpha" value="8"/></bsdf></shape>'
          '<emitter type="constant"><float name="radiance" value="1"/></emitter>')


@pytest.mark.parametrize(("old", "new"), [
    ('id="ball"', 'id="globe"'),
    ('<shape type="sphere"', '<!-- a comment --><shape  type="sphere"'),
    ('<float name="kd" value="0.2"/>', '<rgb name="kd" value="0.2, 0.2, 0.2"/>'),
    ('value="0.5"', 'value="0.50"'),
])
def test_hash_ignores_what_no_renderer_sees(write: Any, old: str, new: str) -> None:
    """Names, comments, white space, the file's own name, another way to write the same value."""
    assert old in HASHED
    changed = load_scene(write(HASHED.replace(old, new), name="other.xml"))
    assert changed.content_hash == load_scene(write(HASHED)).content_hash


@pytest.mark.parametrize(("old", "new"), [
    ('value="0.5"', 'value="0.5000001"'),
    ('type="sphere" id="ball"><float name="radius" value="0.5"/>', 'type="disk" id="ball">'),
    ('name="kd" value="0.2"', 'name="kd" value="0.21"'),
    ('name="ks" value="0.3"', 'name="ks" value="0.31"'),
    ('name="alpha" value="8"', 'name="alpha" value="9"'),
    ('name="radiance" value="1"', 'name="radiance" value="2"'),
    ('id="ball">', 'id="ball"><boolean name="flip_normals" value="true"/>'),
    ('<bsdf type="phong">', '<emitter type="area"/><bsdf type="phong">'),
])
def test_hash_sees_what_the_image_depends_on(write: Any, old: str, new: str) -> None:
    """Shapes, materials, light."""
    assert old in HASHED
    changed = load_scene(write(HASHED.replace(old, new)))
    assert changed.content_hash != load_scene(write(HASHED)).content_hash


def test_hash_sees_camera_film_and_depth(write: Any) -> None:
    """Each on its own; names do not count."""
    scene = load_scene(write(HASHED))
    camera = scene.camera
    variants = [dataclasses.replace(scene, width=9), dataclasses.replace(scene, height=9),
                dataclasses.replace(scene, max_depth=9)]
    variants += [dataclasses.replace(scene, camera=dataclasses.replace(camera, **change)) for change in (
        {"tan_x": 0.1}, {"tan_y": 0.1}, {"near_clip": 0.5}, {"far_clip": 5.0}, {"principal_point": (0.1, 0.0)},
        {"to_world": ((1.0, 0.0, 0.0, 1.0), *camera.to_world[1:])})]
    variants.append(dataclasses.replace(scene, shapes=scene.shapes * 2))
    variants.append(dataclasses.replace(
        scene, shapes=(dataclasses.replace(scene.shapes[0], material=dataclasses.replace(
            scene.shapes[0].material, two_sided=True)),)))
    hashes = {variant.content_hash for variant in variants}
    assert len(hashes) == len(variants) and scene.content_hash not in hashes
    for change in ({"name": "x"}, {"path": None}):
        assert dataclasses.replace(scene, **change).content_hash == scene.content_hash
