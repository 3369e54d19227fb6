"""Bitmaps as layers of an array, of which a vertex reads its shape's own: the bits of one sampler an image."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.files import data_dir
from harness.gpu import renderer as room
from harness.gpu.device import Device
from harness.scene import Scene, load_scene
from harness.shader.library import OURS
from harness.shader.scene import layers as module
from harness.shader.scene.chunk import scene_chunk
from harness.shader.scene.layers import layers, texels
from harness.shader.source import with_defines
from tests.glsl.test_bitmaps import bitmap_xml, image
from tests.gpu.test_loop import LLVMPIPE, drawn


@pytest.fixture
def ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    """The device in use, as one that looks up ahead."""
    profile = dataclasses.replace(room.device(), looks_up_ahead=True)
    monkeypatch.setattr(room, "device", lambda: profile)


def option(name: str, value: str) -> str:
    return f'<string name="{name}" value="{value}"/>'


def ball(x: float, inner: str, emits: str = "") -> str:
    light = f'<emitter type="area">{emits}</emitter>' if emits else ""
    return (f'<shape type="sphere"><transform name="to_world"><translate x="{x}" z="-4"/></transform>'
            f'<bsdf type="phong">{inner}</bsdf>{light}</shape>')


@pytest.fixture
def every_kind(mi: Any, scene: Any, tmp_path: Path) -> Scene:
    """Balls with images of every filter and wrap, of sides that are powers of two and others, turned, many times and
    beyond the unit square; one with two on it, one that shines."""
    kinds = [option("filter_type", kind) + option("wrap_mode", wrap)
             for kind in ("bilinear", "nearest") for wrap in ("repeat", "mirror", "clamp")]
    sizes = [(12, 9), (16, 8), (1, 3), (7, 64), (64, 2), (33, 32)]
    placed = ['<transform name="to_uv"><scale x="3.7" y="-2.3"/><translate x="-0.4" y="0.3"/></transform>',
              '<transform name="to_uv"><rotate z="1" angle="30"/><scale value="5"/></transform>']
    balls = []
    for number, (kind, size) in enumerate(zip(kinds, sizes, strict=True)):
        (tmp_path / f"{number}").mkdir()
        name = f"{number}/{image(mi, tmp_path / str(number) / 'image.png', size=size)}"
        inner = bitmap_xml(name, kind + placed[number % 2], "kd")
        inner += bitmap_xml(name, kind + placed[1 - number % 2], "ks") if number == 2 else ""
        emits = bitmap_xml(name, kind + placed[0], "radiance") if number == 4 else ""
        balls.append(ball(1.5 * number - 3.75, inner, emits))
    return scene("".join(balls) + '<emitter type="constant"><rgb name="radiance" value="0.7,0.8,0.9"/></emitter>')


@pytest.mark.parametrize("strategy", ["mixture", "mis"])
def test_every_filter_and_wrap_has_the_same_bits(every_kind: Scene, strategy: str, ahead: None) -> None:
    source = OURS.tracer(every_kind, strategy)
    found = layers(every_kind.shapes)
    assert found is not None and len(found.images) == 6 and found.lookups == 2
    one_by_one = drawn(every_kind, strategy, with_defines(source, {"BITMAPS_AHEAD": 0}))
    np.testing.assert_array_equal(drawn(every_kind, strategy, source), one_by_one)
    assert one_by_one.std() > 0.05


@pytest.mark.parametrize(("name", "strategy", "exact"), [
    ("textures", "mixture", True), ("textures", "mis", True), ("course_scene", "uniform", True),
    ("course_scene", "nee", False)])
def test_bundled_scenes_are_the_same(name: str, strategy: str, exact: bool, ahead: None) -> None:
    """But for the rounding of another order of instructions, where lights are sampled among procedural textures."""
    scene = load_scene(data_dir("mitsuba_scenes") / f"{name}.xml", width=32, height=24)
    source = OURS.tracer(scene, strategy)
    one_by_one = drawn(scene, strategy, with_defines(source, {"BITMAPS_AHEAD": 0}))
    np.testing.assert_allclose(drawn(scene, strategy, source), one_by_one, rtol=0 if exact else 2e-5)


def test_a_lookup_is_one_of_the_array(every_kind: Scene) -> None:
    """Else nothing above would have been tried."""
    text = scene_chunk(every_kind, "mixture")
    ahead_of_all, one_by_one = text.split("#if BITMAPS_AHEAD\n", 1)[1].split("#else\n", 1)
    assert ahead_of_all.count("textureLod(bitmap_layers") == 2 and "bitmap(bitmap" not in ahead_of_all
    assert one_by_one.count("uniform sampler2D bitmap") == 6


def test_edges_stand_beside_their_image(every_kind: Scene) -> None:
    """What a sampler that repeats sees before the first texel and behind the last."""
    found = layers(every_kind.shapes)
    assert found is not None
    made = texels(found)
    for layer, bitmap, (width, height) in zip(made, found.images, found.sizes, strict=True):
        first, last = (width - 1, 0) if bitmap.wrap_mode == "repeat" else (0, width - 1)
        np.testing.assert_array_equal(layer[:height, -1], layer[:height, first])
        np.testing.assert_array_equal(layer[:height, width], layer[:height, last])
    assert all(side & (side - 1) == 0 for side in found.size) and found.size[0] >= 66 and found.size[1] >= 66


def test_it_is_not_for_few_or_large_images(every_kind: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    assert layers(every_kind.shapes[:2]) is None  # two lookups in place of one
    monkeypatch.setattr(module, "MOST_BYTES", 6 * 128 * 128 * 16 - 1)
    assert layers(every_kind.shapes) is None and "BITMAPS_AHEAD" not in scene_chunk(every_kind, "mixture")


def test_it_is_for_llvmpipe_and_our_own_functions(every_kind: Scene) -> None:
    source = OURS.tracer(every_kind, "mixture")
    line = "#define BITMAPS_AHEAD 1\n"
    assert line in Device.of(LLVMPIPE).fitted(source).text
    assert line not in Device.of({**LLVMPIPE, "GL_RENDERER": "Arc"}).fitted(source).text
    other = OURS.with_line("lib/bitmaps.glsl", "return textureLod(image, at, 0.0).rgb;",
                           "return textureLod(image, at.yx, 0.0).rgb;").tracer(every_kind, "mixture")
    assert line not in Device.of(LLVMPIPE).fitted(other).text
