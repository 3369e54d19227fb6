"""The path's loop in the form that a device gains by: the bits of the plain one, and our own functions only."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from harness.gpu import renderer as room
from harness.gpu.device import Device
from harness.gpu.renderer import TracerRenderer
from harness.scene import Scene, SceneFile, load
from harness.shader.library import OURS, Library
from harness.shader.source import ShaderSource, with_defines

SIZE = (24, 18)
LLVMPIPE = {"GL_RENDERER": "llvmpipe (LLVM 15.0.6, 256 bits)", "GL_VERSION": "4.5", "GL_VENDOR": "Mesa"}
WIDE = frozenset({"avx2", "avx512f", "avx512vl"})
# Draws from a second word of state, as generators of one's own may.
OTHER = OURS.with_line("lib/random.glsl", "uint rng_state;", "uint rng_state; uint drawn;").with_line(
    "lib/random.glsl", "rng_state = pcg_hash(index ^ stream.x) + stream.y;",
    "rng_state = pcg_hash(index ^ stream.x) + stream.y; drawn = 0u;").with_line(
    "lib/random.glsl", "uint state = rng_state;", "uint state = rng_state; state += drawn++;")


def scene_of(name: str) -> Scene:
    return load(SceneFile.bundled(name, SIZE))


def drawn(scene: Scene, strategy: str, source: ShaderSource) -> np.ndarray:
    renderer = TracerRenderer(scene, strategy, source)
    try:
        return renderer.render_batch(1, 5, 12).mean
    finally:
        renderer.release()


@pytest.fixture
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    """The device in use, with the registers of AVX-512."""
    profile = dataclasses.replace(room.device(), starts_ahead=True)
    monkeypatch.setattr(room, "device", lambda: profile)


@pytest.mark.parametrize(("name", "strategy"), [
    ("spheres", "mixture"), ("diffuse", "cosine"), ("motion_blur", "lobes"), ("depth_of_field", "uniform"),
    ("environment", "phong"), ("displaced", "mixture")])
def test_paths_that_start_ahead_are_the_same_paths(name: str, strategy: str, wide: None) -> None:
    scene = scene_of(name)
    source = OURS.tracer(scene, strategy)
    in_turn = with_defines(source, {"STARTS_AHEAD": 0})
    np.testing.assert_array_equal(drawn(scene, strategy, source), drawn(scene, strategy, in_turn))


def test_a_generator_of_ones_own_keeps_its_order(wide: None) -> None:
    """Two paths that shared its second word would draw other numbers."""
    scene = scene_of("spheres")
    source = OTHER.tracer(scene, "mixture")
    plain = source.text.replace("#define STARTS_AHEAD 0\n", "", 1)
    in_turn = drawn(scene, "mixture", source)
    np.testing.assert_array_equal(in_turn, drawn(scene, "mixture", with_defines(source, {"STARTS_AHEAD": 0})))
    assert (drawn(scene, "mixture", dataclasses.replace(source, text=plain)) != in_turn).any()


@pytest.mark.parametrize(("library", "found"), [
    (OURS, []), (OTHER, ["STARTS_AHEAD"]),
    (OURS.with_functions("course/random.glsl", defines={"IMAGE_SIZE": 24}), ["STARTS_AHEAD"]),
    (OURS.with_functions("course/below_surface.glsl"), ["ENDS_BY_DIRECTION"]),
    (OURS.with_line("lib/sampling.glsl", "const float INV_PI = 0.318309886183791;", "const float INV_PI = 0.31831;"),
     ["ENDS_BY_DIRECTION"]),
    (OURS.with_line("lib/path.glsl", "d = drawn.l;", "d = -drawn.l;"), []),
])
def test_the_loop_takes_for_granted_our_own_functions_only(library: Library, found: list[str]) -> None:
    head = library.tracer(scene_of("spheres"), "lobes").text.partition("#line")[0]
    assert re.findall(r"#define (STARTS_AHEAD|ENDS_BY_DIRECTION) 0\n", head) == found


def test_it_is_for_processors_with_many_registers() -> None:
    source = OURS.tracer(scene_of("spheres"), "mixture")
    assert Device.of(LLVMPIPE, WIDE).fitted(source).text.splitlines()[:2] == [
        "#version 420 core", "#define STARTS_AHEAD 1"]
    assert Device.of(LLVMPIPE, frozenset({"avx2"})).fitted(source) is source
    assert Device.of({**LLVMPIPE, "GL_RENDERER": "Arc"}, WIDE).fitted(source) is source
