"""Light from an environment map in the shader, against Mitsuba's own emitter and against the map's definition."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.files import data_dir
from harness.gpu import pingpong
from harness.gpu.samplers import Samplers
from harness.reference.prepare import instantiate
from harness.scene import Scene, load_scene
from harness.scene.bitmaps import environment_texels
from harness.shader.scene.chunk import scene_chunk
from tests.support.tracer import TracerRenderer, evaluate

FREE_UNIT = 4  # of the texture units; the probe uses those before
DIRECTIONS = 6000
# Relative to the brightest texel of a smooth map.
TOLERANCE = 1e-5
TURNED = '<transform name="to_world"><rotate y="1" angle="65"/><rotate x="1" angle="-20"/><rotate z="1" angle="7"/>' \
         '<translate x="3" y="1"/></transform>'
MIRRORED = '<transform name="to_world"><scale x="-1"/><rotate y="1" angle="40"/></transform>'


def directions() -> np.ndarray:
    """(N, 3) float32: all over the sphere, along the seam behind -z, and closer and closer to both poles."""
    rng = np.random.default_rng(2)
    d = rng.normal(size=(DIRECTIONS, 3))
    d[:1000, 0] *= 1e-6
    d[:1000, 2] = -np.abs(d[:1000, 2])
    d[1000:2000, [0, 2]] *= np.geomspace(1e-7, 1, 1000)[:, None]
    return (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)


def smooth(height: int, width: int) -> np.ndarray:
    """(H, W, 3) float32: a different smooth radiance in every direction and channel; one value on each pole."""
    phi = (np.arange(width) + 0.5) / width * 2 * np.pi
    theta = np.arange(height)[:, None] / (height - 1) * np.pi
    waves = [1 + np.cos(theta) / 2 + 0.4 * np.sin(theta) * np.sin(phi + k) for k in range(3)]
    return np.stack(waves, axis=-1).astype(np.float32)


def environment_xml(options: str = "", name: str = "map.exr") -> str:
    """An emitter element."""
    return f'<emitter type="envmap"><string name="filename" value="{name}"/>{options}</emitter>'


def probe(scene: Scene, d: np.ndarray) -> np.ndarray:
    """The tracer's radiance from directions d, (N, 3)."""
    samplers = Samplers(scene)
    try:
        return evaluate("environment.frag", np.c_[d, np.zeros(len(d))], uniforms=samplers.bind(FREE_UNIT),
                        generated={"scene.glsl": scene_chunk(scene, "cosine")})[:, :3]
    finally:
        samplers.release()


def in_mitsuba(mi: Any, scene: Scene, d: np.ndarray) -> np.ndarray:
    """The same of Mitsuba's emitter."""
    import drjit as dr

    si = dr.zeros(mi.SurfaceInteraction3f, len(d))
    si.wi = -mi.Vector3f(d.T)
    return np.array(instantiate(scene.file).environment().eval(si)).T


def defined(texels: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Bilinear interpolation in float64 of a map's texels at directions d of its own space."""
    height, width = texels.shape[:2]
    x = np.arctan2(d[:, 0], -d[:, 2]) / (2 * np.pi) * width - 0.5
    y = np.arctan2(np.hypot(d[:, 0], d[:, 2]), d[:, 1]) / np.pi * (height - 1)
    column, row = np.floor(x).astype(int), np.minimum(np.floor(y).astype(int), height - 2)
    right, down = (x - column)[:, None], (y - row)[:, None]
    total = np.zeros((len(d), 3))
    for i, j in ((0, 0), (1, 0), (0, 1), (1, 1)):
        weight = np.where(i, right, 1 - right) * np.where(j, down, 1 - down)
        total += texels[row + j, (column + i) % width] * weight
    return total


@pytest.mark.parametrize("options", ["", '<float name="scale" value="2.5"/>' + TURNED, MIRRORED],
                         ids=["as it is", "turned and scaled", "mirrored"])
@pytest.mark.parametrize("name", ["map.exr", "map.hdr"])
def test_radiance_is_mitsubas(mi: Any, scene: Any, tmp_path: Path, name: str, options: str) -> None:
    """From every direction, poles and seam included; a translation of what is infinitely far changes nothing."""
    mi.Bitmap(smooth(64, 128)).write(str(tmp_path / name))
    loaded = scene(environment_xml(options, name))
    d = directions()
    local = d.astype(np.float64) @ np.array(loaded.environment.to_world)[:3, :3]
    expected = loaded.environment.scale * defined(environment_texels(loaded.environment), local)
    tolerance = TOLERANCE * expected.max()
    np.testing.assert_allclose(probe(loaded, d), expected, rtol=0, atol=tolerance)
    # Mitsuba takes the inclination's arc cosine, which loses half the digits near the poles.
    off_poles = np.hypot(local[:, 0], local[:, 2]) > 0.01
    theirs = in_mitsuba(mi, loaded, d)
    np.testing.assert_allclose(theirs[off_poles], expected[off_poles], rtol=0, atol=tolerance)
    np.testing.assert_allclose(theirs, expected, rtol=0, atol=20 * tolerance)


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (3, 1), (5, 7), (64, 33)])
def test_radiance_is_bilinear_between_texels(mi: Any, scene: Any, tmp_path: Path, size: tuple[int, int]) -> None:
    """On maps of noise, however small: Mitsuba repeats the last of fewer than three rows.

    A rounded angle shows there, so only the order of Mitsuba's is compared.
    """
    height, width = size
    texels = np.random.default_rng(5).uniform(0, 1, (height, width, 3)).astype(np.float32)
    mi.Bitmap(texels).write(str(tmp_path / "map.exr"))
    loaded = scene(environment_xml())
    d = directions()
    padded = np.pad(texels, ((0, max(0, 3 - height)), (0, 0), (0, 0)), mode="edge")
    expected = defined(padded, d.astype(np.float64))
    np.testing.assert_allclose(probe(loaded, d), expected, rtol=0, atol=2 * TOLERANCE)
    off_poles = np.hypot(d[:, 0], d[:, 2]) > 0.01
    np.testing.assert_allclose(in_mitsuba(mi, loaded, d)[off_poles], expected[off_poles], rtol=0, atol=10 * TOLERANCE)


def test_an_8_bit_map_is_decoded_from_srgb(mi: Any, scene: Any, tmp_path: Path) -> None:
    """As Mitsuba does, although its documentation asks for radiance."""
    rng = np.random.default_rng(4)
    mi.Bitmap(rng.integers(0, 256, (8, 16, 4), dtype=np.uint8)).write(str(tmp_path / "map.png"))
    loaded = scene(environment_xml(name="map.png"))
    d = directions()
    d = d[np.hypot(d[:, 0], d[:, 2]) > 0.01]
    np.testing.assert_allclose(probe(loaded, d), in_mitsuba(mi, loaded, d), rtol=0, atol=2 * TOLERANCE)


def test_bits_do_not_depend_on_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor on how samples are divided into batches: escaped paths are added in the order of their samples."""
    for name in ("environment", "textures"):
        loaded = load_scene(data_dir("mitsuba_scenes") / f"{name}.xml", width=24, height=16)
        images = []
        for samples_per_pass in (32, 5):
            monkeypatch.setattr(pingpong, "MAX_SAMPLES_PER_PASS", samples_per_pass)
            renderer = TracerRenderer(loaded, "mixture")
            images.append(renderer.render_batch(3, 7, 32).mean)
            renderer.release()
        assert images[0].std() > 0.05
        np.testing.assert_array_equal(images[0], images[1])
