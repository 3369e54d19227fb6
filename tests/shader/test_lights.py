"""Scenes that have next to nothing to sample light from, or too much: a picture, or a refusal in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError, SceneError
from harness.gpu.renderer import TracerRenderer
from harness.machine.mitsuba_runtime import import_mitsuba
from harness.scene import Scene, load_scene
from harness.scene.importance import bilinear
from harness.scene.lights import ENVIRONMENT, MOST_LIGHTS, lights_sampled
from harness.scene.strategies import suitable_strategies
from harness.shader.library import OURS

SAMPLING = ("nee", "mis")
KD = 0.5
# A white wall before the camera, which sees nothing else and is lit from its front.
WALL = """<scene version="3.0.0">
    <integrator type="path"><integer name="max_depth" value="2"/></integrator>
    <sensor type="perspective">
        <transform name="to_world"><lookat origin="0, 0, 2" target="0, 0, 0" up="0, 1, 0"/></transform>
        <float name="fov" value="40"/>
        <film type="hdrfilm">
            <integer name="width" value="12"/> <integer name="height" value="12"/> <rfilter type="box"/>
        </film>
    </sensor>
    <shape type="rectangle">
        <transform name="to_world"><scale value="5"/></transform>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.5, 0.5"/></bsdf>
    </shape>
    {more}
</scene>"""
MAP = '<emitter type="envmap"><string name="filename" value="map.exr"/></emitter>'


def light(radiance: str, transform: str = '<translate z="4"/>') -> str:
    """A sphere behind the camera that shines."""
    return (f'<shape type="sphere"><transform name="to_world">{transform}</transform><emitter type="area">'
            f'<rgb name="radiance" value="{radiance}"/></emitter></shape>')


def written(folder: Path, more: str, texels: np.ndarray | None = None) -> Scene:
    """The wall and what else there is, `texels` in its map."""
    if texels is not None:
        import_mitsuba().Bitmap(np.ascontiguousarray(texels, np.float32)).write(str(folder / "map.exr"))
    path = folder / "wall.xml"
    path.write_text(WALL.format(more=more), encoding="utf-8")
    return load_scene(path)


def rendered(scene: Scene, strategy: str, spp: int = 16) -> np.ndarray:
    """Its pixels, none of whose samples was left out."""
    renderer = TracerRenderer(scene, strategy)
    try:
        batch = renderer.render_batch(0, 0, spp)
    finally:
        renderer.release()
    assert batch.rejected == 0
    return batch.mean


def one_texel() -> np.ndarray:
    """A map that is black but for one texel, above the wall's front and to its right."""
    texels = np.zeros((16, 32, 3))
    texels[5, 13] = 400, 200, 100
    return texels


@pytest.mark.parametrize("strategy", SAMPLING)
@pytest.mark.parametrize(("more", "texels"), [
    ("", None), (light("0, 0, 0"), None), (MAP, np.zeros((4, 8, 3))),
    ('<emitter type="constant"><rgb name="radiance" value="0, 0, 0"/></emitter>', None),
], ids=["nothing", "a black light", "a black map", "a black sky"])
def test_without_light_the_picture_is_black(
    tmp_path: Path, strategy: str, more: str, texels: np.ndarray | None,
) -> None:
    scene = written(tmp_path, more, texels)
    assert lights_sampled(scene, strategy) == ()
    assert not set(SAMPLING).intersection(suitable_strategies(scene))  # a report does not ask for them
    assert not rendered(scene, strategy, 4).any()


@pytest.mark.parametrize("strategy", SAMPLING)
def test_a_light_of_no_radiance_beside_one_is_left_out(tmp_path: Path, strategy: str) -> None:
    """The image is that without it, bit for bit."""
    dark = light("0, 0, 0", '<translate x="9" z="4"/>')
    scene = written(tmp_path, light("3, 2, 1") + dark)
    assert [(each.shape, each.chance) for each in lights_sampled(scene, strategy)] == [(1, 1.0)]
    found = rendered(scene, strategy)
    assert found.any()
    np.testing.assert_array_equal(found, rendered(written(tmp_path, light("3, 2, 1")), strategy))


@pytest.mark.parametrize("shape", [
    light("1, 1, 1", '<scale value="0"/>'),
    '<shape type="sphere"><float name="radius" value="0"/><emitter type="area"/></shape>',
    '<shape type="rectangle"><transform name="to_world"><scale x="0"/></transform><emitter type="area"/></shape>',
    '<shape type="disk"><transform name="to_world"><scale value="0"/></transform><emitter type="area"/></shape>',
    '<shape type="cube"><transform name="to_world"><scale y="0"/></transform><emitter type="area"/></shape>',
    '<shape type="cylinder"><float name="radius" value="0"/><emitter type="area"/></shape>',
    '<shape type="cylinder"><point name="p0" value="0, 0, 1"/><point name="p1" value="0, 0, 1"/>'
    '<emitter type="area"/></shape>',
])
def test_a_light_of_no_area_is_refused_with_its_line(tmp_path: Path, shape: str) -> None:
    with pytest.raises(SceneError, match=r"wall\.xml:14: [^\n]*$"):
        written(tmp_path, shape)


@pytest.mark.parametrize("strategy", ["nee", "mis", "cosine+nee", "uniform+mis-power"])
def test_all_light_from_one_texel_of_a_map_is_found(tmp_path: Path, strategy: str) -> None:
    """Against the integral over the map: radiance times cosine, in directions that are even over the sphere's area."""
    texels = one_texel()
    scene = written(tmp_path, MAP, texels)
    assert [each.shape for each in lights_sampled(scene, strategy.partition("+")[2][:3] or strategy)] == [ENVIRONMENT]
    z, phi = np.meshgrid((np.arange(400) + 0.5) / 400 * 2 - 1, (np.arange(800) + 0.5) / 800 * 2 * np.pi)
    d = np.stack([np.sqrt(1 - z**2) * np.cos(phi), z, np.sqrt(1 - z**2) * np.sin(phi)], axis=-1).reshape(-1, 3)
    incoming = bilinear(texels, d) * np.clip(d[:, 2], 0, None)[:, None]
    expected = KD / np.pi * incoming.mean(axis=0) * 4 * np.pi
    assert expected[0] > 1
    found = rendered(scene, strategy, 64).mean((0, 1))
    np.testing.assert_allclose(found, expected, rtol=0.01)  # 9216 samples whose deviation is a third of their mean


@pytest.mark.parametrize("strategy", SAMPLING)
def test_more_lights_than_are_written_out_are_refused(tmp_path: Path, strategy: str) -> None:
    """In a line that says what to use instead; and that does render it."""
    each = [light("1, 1, 1", f'<scale value="0.01"/><translate x="{number / 100}" z="4"/>')
            for number in range(MOST_LIGHTS + 1)]
    scene = written(tmp_path, "".join(each))
    with pytest.raises(HarnessError, match=rf"^scene 'wall' has {MOST_LIGHTS + 1} lights; strategies that sample them "
                                           rf"take {MOST_LIGHTS} at most: use mixture, or join lights [^\n]*$"):
        OURS.tracer(scene, strategy)
    assert len(lights_sampled(written(tmp_path, "".join(each[1:])), strategy)) == MOST_LIGHTS
    OURS.tracer(scene, "mixture")
