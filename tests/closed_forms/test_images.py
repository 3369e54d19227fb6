"""Scenes of images whose answer is known in closed form: both renderers against it, neither against the other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.gpu.renderer import TracerRenderer
from harness.machine.mitsuba_runtime import import_mitsuba
from harness.reference.renderer import ReferenceRenderer
from harness.samples.estimate import Estimate
from harness.scene import load_scene
from harness.work.batches import render_estimate

SIDE = 8  # pixels, and texels of the textures
# A rectangle [-1, 1]² at z = 0 that fills the film exactly: half of 2 over a distance of 2 is tan 26.565°.
SENSOR = f"""<sensor type="perspective"><float name="fov" value="53.13010235415598"/>
    <transform name="to_world"><lookat origin="0, 0, 2" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="{SIDE}"/><integer name="height" value="{SIDE}"/>
    <rfilter type="box"/></film></sensor>"""
# Float32's share of a mean of samples.
ROUNDING = 1e-5
RENDERERS = ["uniform", "cosine", "lobes", "mixture", "mitsuba"]


def write_image(path: Path, pixels: np.ndarray) -> None:
    """An image file of (H, W, 3) float32."""
    import_mitsuba().Bitmap(np.ascontiguousarray(pixels, dtype=np.float32)).write(str(path))


def rendered(folder: Path, body: str, renderer: str, spp: int, depth: int = 2) -> Estimate:
    """The image of a scene; `renderer` is a strategy of the tracer or 'mitsuba'."""
    path = folder / "scene.xml"
    path.write_text(f'<scene version="3.0.0">{SENSOR}<integrator type="path"><integer name="max_depth" '
                    f'value="{depth}"/></integrator>{body}</scene>', encoding="utf-8")
    scene = load_scene(path)
    source: Any = ReferenceRenderer(scene.file) if renderer == "mitsuba" else TracerRenderer(scene, renderer)
    return render_estimate(source, spp)


def texture(name: str, file: str, options: str = "") -> str:
    """A bitmap element."""
    return f'<texture type="bitmap" name="{name}"><string name="filename" value="{file}"/>{options}</texture>'


@pytest.mark.parametrize("renderer", ["cosine", "mitsuba"])
def test_a_light_shows_its_texels(tmp_path: Path, renderer: str) -> None:
    """A light that fills the film, one texel a pixel, unfiltered: the image is the texture, its first row below."""
    texels = np.random.default_rng(1).uniform(0, 5, (SIDE, SIDE, 3)).astype(np.float32)
    write_image(tmp_path / "light.exr", texels)
    light = texture("radiance", "light.exr", '<string name="filter_type" value="nearest"/>')
    body = f'<shape type="rectangle"><emitter type="area">{light}</emitter></shape>'
    mean = rendered(tmp_path, body, renderer, 64).mean
    np.testing.assert_allclose(mean, texels[::-1], rtol=1e-5)


@pytest.mark.parametrize("renderer", ["cosine", "mitsuba"])
def test_a_filtered_light_keeps_its_mean(tmp_path: Path, renderer: str) -> None:
    """The integral of a tiled bilinear image over its square is the mean of its texels, whatever it is turned by."""
    texels = np.random.default_rng(2).uniform(0, 5, (3, 5, 3)).astype(np.float32)
    write_image(tmp_path / "light.exr", texels)
    tiled = '<transform name="to_uv"><scale x="-2" y="3"/><translate x="0.3"/></transform>'
    light = texture("radiance", "light.exr", tiled)
    body = f'<shape type="rectangle"><emitter type="area">{light}</emitter></shape>'
    estimate = rendered(tmp_path, body, renderer, 512)
    error = np.abs(estimate.image_mean[:3] - texels.mean(axis=(0, 1)))
    assert (error < 9 * np.sqrt(estimate.image_variance[:3]) + ROUNDING).all() and (error < 2e-2).all()


@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_textured_wall_under_a_white_sky(tmp_path: Path, renderer: str) -> None:
    """Each pixel reflects its texel's kd and a part of its ks that depends on the view alone; each is 0 in some texels.

    For α = 1 and light of radiance 1 from everywhere that part is 1/π ∫ max(r·l, 0) max(n·l, 0) dl, which for an angle
    θ between r and n is 2/(3π) (sin θ + (π - θ) cos θ): Cho & Saul 2009, "Kernel Methods for Deep Learning", eq. 6.
    """
    rng = np.random.default_rng(3)
    kd, ks = rng.uniform(0, 0.6, (2, SIDE, SIDE, 3)).astype(np.float32)
    kd[rng.random((SIDE, SIDE)) < 0.4] = 0
    ks[rng.random((SIDE, SIDE)) < 0.4] = 0
    assert ((kd == 0) & (ks == 0)).all(axis=2).any()
    write_image(tmp_path / "kd.exr", kd)
    write_image(tmp_path / "ks.exr", ks)
    nearest = '<string name="filter_type" value="nearest"/>'
    estimate = rendered(tmp_path, f'<emitter type="constant"/><shape type="rectangle"><bsdf type="phong">'
                        f'{texture("kd", "kd.exr", nearest)}{texture("ks", "ks.exr", nearest)}'
                        '<float name="alpha" value="1"/></bsdf></shape>', renderer, 2048)
    y, x = (np.mgrid[0:8 * SIDE, 0:8 * SIDE] + 0.5) / (4 * SIDE) - 1  # eight points a pixel each way
    theta = np.arctan(np.hypot(x, y) / 2)
    part = 2 / (3 * np.pi) * (np.sin(theta) + (np.pi - theta) * np.cos(theta))
    expected = kd[::-1] + ks[::-1] * part.reshape(SIDE, 8, SIDE, 8).mean(axis=(1, 3))[..., None]
    error = np.abs(estimate.mean - expected)
    # 192 deviations, each estimated from 8 batches: a Student's t of 7 degrees of freedom.
    assert (error <= 9 * np.sqrt(estimate.variance) + ROUNDING).all()
    image_error = np.abs(estimate.image_mean[:3] - expected.mean(axis=(0, 1)))
    assert (image_error < 9 * np.sqrt(estimate.image_variance[:3]) + ROUNDING).all()
    assert (image_error < 2e-3).all()


@pytest.mark.parametrize("renderer", ["uniform", "mixture", "mitsuba"])
@pytest.mark.parametrize("turn", ['<rotate x="1" angle="90"/>', '<rotate z="1" angle="50"/><rotate x="1" angle="25"/>'])
def test_a_wall_under_a_sky_that_grows_brighter_upwards(tmp_path: Path, renderer: str, turn: str) -> None:
    """Radiance a + b (d·up) from direction d gives albedo (a + 2/3 b (n·up)), wherever `to_world` turns up to.

    A map of rows in the cosine of their angle is that radiance, but for its interpolation: off by (π/255)²/8 b at most.
    """
    a, b, albedo, rows = 1.0, 0.8, 0.5, 256
    row = a + b * np.cos(np.arange(rows) / (rows - 1) * np.pi)
    write_image(tmp_path / "sky.exr", np.broadcast_to(row[:, None, None], (rows, 4, 3)))
    body = (f'<emitter type="envmap"><string name="filename" value="sky.exr"/><transform name="to_world">{turn}'
            f'</transform></emitter><shape type="rectangle"><bsdf type="phong"><float name="kd" value="{albedo}"/>'
            '</bsdf></shape>')
    estimate = rendered(tmp_path, body, renderer, 2048)
    scene = load_scene(tmp_path / "scene.xml")
    up = np.array(scene.environment.to_world)[:3, 1]  # type: ignore[union-attr]  # a map
    expected = albedo * (a + 2 / 3 * b * up[2])
    error = np.abs(estimate.image_mean[:3] - expected)
    assert (error < 9 * np.sqrt(estimate.image_variance[:3]) + 2e-5 * b).all()
    assert (error < 2e-3).all()
