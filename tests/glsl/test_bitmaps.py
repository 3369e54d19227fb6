"""Bitmaps and checkerboards in the shader, against Mitsuba's own textures at the same (u, v)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.errors import HarnessError, SceneError
from harness.gpu.context import context
from harness.gpu.samplers import Samplers
from harness.reference.prepare import instantiate
from harness.scene import Scene, load_scene
from harness.shader.scene.chunk import scene_chunk
from tests.support.scenes import AT_ORIGIN
from tests.support.tracer import TracerRenderer, evaluate

FREE_UNIT = 4  # of the texture units; the probe uses those before
POINTS = 4000
SIZE = (12, 9)  # width, height: no powers of two, and not square
# Colours agree to this where (u, v) lie within a few tiles of the origin: float32 resolves a texel to 1e-6 there.
TOLERANCE = 1e-5


def probe(scene: Scene, uv: np.ndarray, shape: int = 0) -> dict[str, np.ndarray]:
    """kd, ks, alpha, p_glossy and emission of a shape at (u, v), (N, 2)."""
    samplers = Samplers(scene)
    try:
        found = evaluate("texture.frag", np.c_[uv, np.full(len(uv), shape), np.zeros(len(uv))], outputs=3,
                         uniforms=samplers.bind(FREE_UNIT), generated={"scene.glsl": scene_chunk(scene, "mixture")})
    finally:
        samplers.release()
    return {"kd": found[:, :3], "alpha": found[:, 3], "ks": found[:, 4:7], "p_glossy": found[:, 7],
            "emission": found[:, 8:11]}


def in_mitsuba(mi: Any, scene: Scene, uv: np.ndarray, shape: int = 0) -> np.ndarray:
    """A diffuse shape's albedo at (u, v) in Mitsuba, (N, 3) float32."""
    import drjit as dr

    si = dr.zeros(mi.SurfaceInteraction3f, len(uv))
    si.uv = mi.Point2f(uv.T.astype(np.float32))
    return np.array(instantiate(scene.file).shapes()[shape].bsdf().eval_diffuse_reflectance(si)).T


def random_uv(low: float = -2, high: float = 3) -> np.ndarray:
    """Points of the plane in float32, beyond the unit square too, and the corners of that."""
    uv = np.random.default_rng(3).uniform(low, high, (POINTS, 2))
    uv[:4] = [[0, 0], [0, 1], [1, 0], [1, 1]]
    return uv.astype(np.float32)


def image(mi: Any, path: Path, dtype: Any = np.uint8, channels: int = 3, size: tuple[int, int] = SIZE) -> str:
    """Write a random image; its name."""
    shape = (size[1], size[0], channels)
    rng = np.random.default_rng(channels)
    if np.issubdtype(dtype, np.integer):
        bitmap = mi.Bitmap(rng.integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True))
        bitmap.set_srgb_gamma(True)
    else:
        bitmap = mi.Bitmap(rng.uniform(0, 1, shape).astype(dtype))
    bitmap.write(str(path))
    return path.name


def bitmap_xml(filename: str, options: str = "", name: str = "reflectance") -> str:
    """A texture element."""
    return f'<texture type="bitmap" name="{name}"><string name="filename" value="{filename}"/>{options}</texture>'


def sphere(inner: str) -> str:
    """A diffuse sphere."""
    return f'<shape type="sphere"><bsdf type="diffuse">{inner}</bsdf></shape>'


@pytest.mark.parametrize("filter_type", ["bilinear", "nearest"])
@pytest.mark.parametrize("wrap_mode", ["repeat", "mirror", "clamp"])
def test_filters_and_wraps_as_mitsuba(mi: Any, scene: Any, tmp_path: Path, filter_type: str, wrap_mode: str) -> None:
    """Over several tiles, the edges of the image included."""
    options = (f'<string name="filter_type" value="{filter_type}"/><string name="wrap_mode" value="{wrap_mode}"/>')
    loaded = scene(sphere(bitmap_xml(image(mi, tmp_path / "image.png"), options)))
    uv = random_uv()
    at = uv * SIZE
    if filter_type == "nearest":  # which texel a point between two belongs to is decided by rounding
        uv = uv[(np.abs(at - np.round(at)) > 1e-4).all(axis=1)]
    np.testing.assert_allclose(probe(loaded, uv)["kd"], in_mitsuba(mi, loaded, uv), rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize(("name", "dtype", "channels", "raw"), [
    ("8.png", np.uint8, 3, False), ("8.png", np.uint8, 3, True), ("8.jpg", np.uint8, 3, False),
    ("grey.png", np.uint8, 1, False), ("grey.png", np.uint8, 1, True), ("alpha.png", np.uint8, 4, False),
    ("grey-alpha.png", np.uint8, 2, False), ("16.png", np.uint16, 3, False), ("16.png", np.uint16, 3, True),
    ("half.exr", np.float16, 3, False), ("float.exr", np.float32, 3, False), ("float.exr", np.float32, 3, True),
    ("grey.exr", np.float32, 1, False), ("alpha.exr", np.float32, 4, False), ("float.hdr", np.float32, 3, False),
    ("float.pfm", np.float32, 3, False)])
def test_decodes_as_mitsuba(mi: Any, scene: Any, tmp_path: Path, name: str, dtype: Any, channels: int,
                            raw: bool) -> None:
    """Whatever the file's format, depth and channels; `raw` counts for all of them."""
    options = f'<boolean name="raw" value="{str(raw).lower()}"/>'
    loaded = scene(sphere(bitmap_xml(image(mi, tmp_path / name, dtype, channels), options)))
    uv = random_uv(0, 1)
    np.testing.assert_allclose(probe(loaded, uv)["kd"], in_mitsuba(mi, loaded, uv), rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1), (2, 2), (16384, 2)])
def test_any_size(mi: Any, scene: Any, tmp_path: Path, size: tuple[int, int]) -> None:
    """A single texel; a line; the longest row that GL takes here."""
    loaded = scene(sphere(bitmap_xml(image(mi, tmp_path / "image.png", size=size))))
    uv = random_uv(0, 1)
    # An error of a float32 spacing in u moves a point by as many texels; colours differ by 1 from one to the next.
    tolerance = max(TOLERANCE, 2 * max(size) * np.spacing(np.float32(1)))
    np.testing.assert_allclose(probe(loaded, uv)["kd"], in_mitsuba(mi, loaded, uv), rtol=0, atol=tolerance)


@pytest.mark.parametrize("transform", [
    '<scale x="3" y="-2"/><translate x="0.3" y="0.1"/>',
    '<rotate z="1" angle="35"/><scale x="1.5" y="0.5"/><translate x="-0.2" y="0.7" z="4"/>',
    '<rotate x="1" angle="40"/>', '<matrix value="2 0.5 0.1 -1 3 0.2 0 0 1"/>'])
@pytest.mark.parametrize("plugin", ["bitmap", "checkerboard"])
def test_coordinates_are_transformed_as_in_mitsuba(mi: Any, scene: Any, tmp_path: Path, plugin: str,
                                                   transform: str) -> None:
    """By the plane's part of `to_uv`, whatever it does to z."""
    to_uv = f'<transform name="to_uv">{transform}</transform>'
    texture = bitmap_xml(image(mi, tmp_path / "image.png"), to_uv) if plugin == "bitmap" else board_xml(to_uv)
    loaded = scene(sphere(texture))
    uv = random_uv(-1, 1)
    expected = in_mitsuba(mi, loaded, uv)
    close = np.abs(probe(loaded, uv)["kd"] - expected).max(axis=1) < 2 * TOLERANCE
    # A checkerboard's edges are decided by rounding.
    assert close.mean() > (0.9995 if plugin == "checkerboard" else 1 - 1e-9)


def board_xml(options: str = "", name: str = "reflectance") -> str:
    """A checkerboard of two colours."""
    return (f'<texture type="checkerboard" name="{name}"><rgb name="color0" value="0.9, 0.6, 0.1"/>'
            f'<rgb name="color1" value="0.1, 0.2, 0.7"/>{options}</texture>')


def test_checkerboards_are_mitsubas(mi: Any, scene: Any) -> None:
    """To the bit, on the squares' edges too; numbers and defaults for colours."""
    edges = np.stack(np.meshgrid(np.arange(-4, 5) / 4, np.arange(-4, 5) / 4), axis=-1).reshape(-1, 2)
    uv = np.concatenate([random_uv(), edges, edges + 1e-6, edges - 1e-6]).astype(np.float32)
    for texture in (board_xml(), '<texture type="checkerboard" name="reflectance"/>'):
        loaded = scene(sphere(texture))
        np.testing.assert_array_equal(probe(loaded, uv)["kd"], in_mitsuba(mi, loaded, uv))


def test_every_slot_of_every_shape_gets_its_own(mi: Any, scene: Any, tmp_path: Path) -> None:
    """Five shapes with one image in different slots and places and read differently, a second one, a checkerboard.

    Every place is compared with a scene of that texture alone, which the tests above compare with Mitsuba.
    """
    first = image(mi, tmp_path / "first.png")
    second = image(mi, tmp_path / "second.png", channels=1)
    coarse, raw = '<string name="filter_type" value="nearest"/>', '<boolean name="raw" value="true"/>'
    turned = '<transform name="to_uv"><rotate z="1" angle="30"/></transform>'

    def phong(kd: str, ks: str, alpha: str) -> str:
        return f'<shape type="sphere"><bsdf type="phong">{kd}{ks}{alpha}</bsdf></shape>'

    loaded = scene(
        phong(bitmap_xml(first, name="kd"), bitmap_xml(first, turned, name="ks"), bitmap_xml(second, name="alpha"))
        + phong('<rgb name="kd" value="0.1, 0.2, 0.3"/>', bitmap_xml(first, name="ks"), board_xml(name="alpha"))
        + phong(board_xml(turned, name="kd"), board_xml(name="ks"), '<float name="alpha" value="7"/>')
        + f'<shape type="disk"><emitter type="area">{bitmap_xml(first, turned, name="radiance")}</emitter></shape>'
        + phong(bitmap_xml(first, coarse, name="kd"), bitmap_xml(first, raw, name="ks"), ""))
    assert scene_chunk(loaded, "mixture").count("uniform sampler2D bitmap") == 4

    uv = random_uv(0, 1)
    alone = {name: probe(scene(sphere(texture)), uv)["kd"] for name, texture in {
        "first": bitmap_xml(first), "first turned": bitmap_xml(first, turned), "second": bitmap_xml(second),
        "coarse": bitmap_xml(first, coarse), "raw": bitmap_xml(first, raw),
        "board": board_xml(), "board turned": board_xml(turned)}.items()}
    at = [probe(loaded, uv, shape) for shape in range(5)]
    constant = np.broadcast_to(np.float32([0.1, 0.2, 0.3]), (len(uv), 3))
    for found, expected in (
            (at[0]["kd"], alone["first"]), (at[0]["ks"], alone["first turned"]),
            (at[0]["alpha"], alone["second"][:, 0]),
            (at[1]["kd"], constant), (at[1]["ks"], alone["first"]), (at[1]["alpha"], alone["board"][:, 0]),
            (at[2]["kd"], alone["board turned"]), (at[2]["ks"], alone["board"]), (at[2]["alpha"], 7),
            (at[3]["emission"], alone["first turned"]), (at[4]["kd"], alone["coarse"]), (at[4]["ks"], alone["raw"])):
        np.testing.assert_array_equal(found, np.broadcast_to(expected, found.shape))
    largest = alone["first"].max(axis=1)
    np.testing.assert_allclose(at[1]["p_glossy"], largest / (largest + np.float32(0.3)), rtol=1e-6)


def test_two_renderers_do_not_disturb_each_other(mi: Any, scene: Any, tmp_path: Path) -> None:
    """Their images are bound to the same units, one after the other; each renders what it renders alone."""
    seen = '<shape type="rectangle"><transform name="to_world"><translate z="2.5"/><rotate y="1" angle="180"/>' \
           '<translate z="5"/></transform><emitter type="area">{}</emitter></shape>'
    scenes = [scene(seen.format(bitmap_xml(image(mi, tmp_path / f"{n}.exr", np.float32, n), name="radiance")),
                    sensor=AT_ORIGIN) for n in (1, 3, 4)]
    alone = []
    for each in scenes:
        renderer = TracerRenderer(each, "cosine")
        alone.append(renderer.render_batch(0, 0, 8).mean)
        renderer.release()
    assert all(0.1 < mean.mean() < 0.9 and mean.std() > 0.01 for mean in alone)
    together = [TracerRenderer(each, "cosine") for each in scenes]
    for _ in range(2):
        for renderer, mean in zip(together, alone, strict=True):
            np.testing.assert_array_equal(renderer.render_batch(0, 0, 8).mean, mean)
    for renderer in together:
        renderer.release()


def test_an_image_that_changed_is_refused(mi: Any, scene: Any, tmp_path: Path) -> None:
    """Its digest is part of what batches are stored under, so it must still be that image."""
    loaded = scene(sphere(bitmap_xml(image(mi, tmp_path / "image.png"))))
    image(mi, tmp_path / "image.png", channels=4)
    with pytest.raises(SceneError, match=r"image\.png: the image changed since the scene was loaded"):
        TracerRenderer(loaded, "cosine")
    assert load_scene(loaded.path).content_hash != loaded.content_hash


def test_an_image_too_large_for_the_device_is_refused(mi: Any, scene: Any, tmp_path: Path) -> None:
    """Before GL is asked to hold it."""
    largest = int(context().info["GL_MAX_TEXTURE_SIZE"])
    loaded = scene(sphere(bitmap_xml(image(mi, tmp_path / "image.png", size=(largest + 1, 1)))))
    with pytest.raises(HarnessError, match=rf"has {largest + 1} x 1 texels; this device takes {largest} a side"):
        TracerRenderer(loaded, "cosine")
