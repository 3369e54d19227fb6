"""Any Mitsuba scene has a reference, whether or not our tracer understands it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.errors import HarnessError, SceneError
from harness.reference import ReferenceRenderer
from harness.reference.prepare import prepare
from harness.scene import SceneFile, load

SENSOR = """<sensor type="perspective"><float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0,0,4" target="0,0,0" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film></sensor>"""
SKY = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'
PATH = '<integrator type="path"><integer name="max_depth" value="4"/></integrator>'
# A tetrahedron, in the two formats of meshes that Mitsuba reads without help.
CORNERS = ((0, 0, 1), (0.9, 0, -0.5), (-0.5, 0.8, -0.5), (-0.5, -0.8, -0.5))
FACES = ((0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2))


def write(folder: Path, body: str, integrator: str = PATH) -> SceneFile:
    """A scene under a white sky."""
    path = folder / "scene.xml"
    path.write_text(f'<scene version="3.0.0">{integrator}{SENSOR}{SKY}\n{body}</scene>', encoding="utf-8")
    return SceneFile(path)


def image(file: SceneFile, *arguments: Any, **options: Any) -> np.ndarray:
    """A few samples of it."""
    return ReferenceRenderer(file, *arguments, **options).render_batch(0, 0, 64).mean


def meshes(folder: Path) -> None:
    (folder / "m.obj").write_text("".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS)
                                  + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in FACES))
    (folder / "m.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
        + "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS) + "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES))


@pytest.mark.parametrize(("body", "low", "high"), [
    # Glass takes nothing away: white all over, but for the paths that are still inside at the end.
    ('<shape type="sphere"><bsdf type="dielectric"/></shape>', 0.7, 1.0),
    ('<shape type="sphere"><bsdf type="principled"><rgb name="base_color" value="0.5"/></bsdf></shape>', 0.3, 0.9),
    # A convex body under a white sky is its albedo.
    ('<shape type="obj"><string name="filename" value="m.obj"/>'
     '<boolean name="face_normals" value="true"/><bsdf type="diffuse">'
     '<rgb name="reflectance" value="0.5"/></bsdf></shape>', 0.45, 0.55),
    ('<shape type="ply"><string name="filename" value="m.ply"/>'
     '<boolean name="face_normals" value="true"/><bsdf type="diffuse">'
     '<rgb name="reflectance" value="0.5"/></bsdf></shape>', 0.45, 0.55),
], ids=["dielectric", "principled", "obj", "ply"])
def test_what_our_tracer_refuses_is_rendered(mi: Any, tmp_path: Path, body: str, low: float, high: float) -> None:
    """The sky around is white; what stands in the middle is as bright as it should be."""
    meshes(tmp_path)
    file = write(tmp_path, body)
    with pytest.raises(SceneError):
        load(file)
    found = image(file)
    np.testing.assert_allclose(found[0, 0], 1, rtol=1e-6)
    assert low <= found[3:5, 3:5].mean() <= high


@pytest.mark.parametrize("integrator", ["volpath", "direct"])
def test_the_integrator_is_the_files(mi: Any, tmp_path: Path, integrator: str) -> None:
    sphere = '<shape type="sphere"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>'
    file = write(tmp_path, sphere, f'<integrator type="{integrator}"/>')
    renderer = ReferenceRenderer(file)
    assert renderer.identity["integrator"] == integrator
    assert renderer.render_batch(0, 0, 64).mean[3:5, 3:5].mean() == pytest.approx(0.5, abs=0.03)
    assert ReferenceRenderer(file, "path", max_depth=1).identity["integrator"] == "path"
    assert image(file, "path", max_depth=1)[3:5, 3:5].max() == 0, "another is used where it is named"


def test_parameters_reach_the_image(mi: Any, tmp_path: Path) -> None:
    body = """<default name="albedo" value="0.5"/><shape type="sphere"><bsdf type="principled">
        <rgb name="base_color" value="$albedo"/><float name="specular" value="0"/></bsdf></shape>"""
    file = write(tmp_path, body)
    bright, dark = (image(SceneFile(file.path, given))[3:5, 3:5].mean() for given in ((), (("albedo", "0.1"),)))
    assert dark < 0.5 * bright


def test_an_unknown_variant_is_refused(tmp_path: Path) -> None:
    with pytest.raises(HarnessError, match=r"unknown variant 'llvm_rgb'; allowed: .*llvm_ad_rgb") as caught:
        ReferenceRenderer(write(tmp_path, ""), variant="llvm_rgb")
    assert "\n" not in str(caught.value)


def test_what_nobody_knows_is_refused_in_one_line(mi: Any, tmp_path: Path) -> None:
    """With the file and line."""
    with pytest.raises(SceneError, match=r"scene\.xml:4: .*cone") as caught:
        ReferenceRenderer(write(tmp_path, '<shape type="cone"/>'))
    assert "\n" not in str(caught.value)


def test_words_of_ours_beside_what_we_do_not_know_are_refused(mi: Any, tmp_path: Path) -> None:
    """They can only be expanded with a reading of the whole scene."""
    with pytest.raises(SceneError, match="bsdf 'dielectric' is not supported"):
        ReferenceRenderer(write(tmp_path, """<shape type="sphere"><bsdf type="dielectric"/></shape>
            <shape type="displacedsphere"/>"""))


@pytest.mark.parametrize(("scale", "shift", "told"), [(1.0, 0.0, False), (0.001, 0.0, True), (1.0, 1000.0, True)],
                         ids=["ordinary", "tiny", "far"])
def test_a_scene_of_a_scale_that_mitsuba_cannot_keep_is_warned_of(mi: Any, tmp_path: Path, scale: float, shift: float,
                                                                  told: bool, caplog: pytest.LogCaptureFixture) -> None:
    """Our tracer does not read glass, so the scene cannot be moved into a frame of its own."""
    sensor = SENSOR.replace('origin="0,0,4" target="0,0,0"', f'origin="{shift},0,{4 * scale}" target="{shift},0,0"')
    sensor = sensor.replace("</sensor>", '<float name="near_clip" value="1e-5"/></sensor>')
    (tmp_path / "scene.xml").write_text(
        f'<scene version="3.0.0">{PATH}{sensor}{SKY}<shape type="sphere"><point name="center" x="{shift}" y="0" z="0"/>'
        f'<float name="radius" value="{scale}"/><bsdf type="dielectric"/></shape></scene>', encoding="utf-8")
    prepare(SceneFile(tmp_path / "scene.xml"))
    assert ("lifts rays off surfaces" in caplog.text) == told


def test_a_scene_of_which_nothing_is_seen_is_not(mi: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Where no ray meets anything there is no width."""
    prepare(write(tmp_path, '<shape type="sphere"><point name="center" x="90" y="0" z="0"/><bsdf type="dielectric"/>'
                            '</shape>'))
    assert "lifts rays" not in caplog.text
