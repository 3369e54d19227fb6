"""The taps observe the production shader: its bits, and the numbers and rays that it draws."""

from __future__ import annotations

import numpy as np
import pytest

from harness.diagnosis import expected
from harness.gpu.renderer import TracerRenderer
from harness.gpu.tap import PATH_RECORDS, VERTEX_RECORDS, Look, Tap, tapped, types
from harness.scene import Scene, SceneFile, load
from harness.shader.library import OURS

SIZE = (24, 18)


def scene_of(name: str) -> Scene:
    return load(SceneFile.bundled(name, SIZE))


def look(**changes: object) -> Look:
    junk = np.random.default_rng(0).random((SIZE[1], SIZE[0], 4)).astype(np.float32)
    return Look(**{"replica": 2, "first": 7, "samples": 1, "tapped": 0, "number": 0, "previous": junk,  # type: ignore
                   **changes})


@pytest.mark.parametrize(("name", "strategy"), [
    ("spheres", "mixture"), ("textures", "lobes"), ("motion_blur", "cosine"), ("displaced", "mixture"),
    ("depth_of_field", "uniform"), ("furnace_phong", "phong")])
def test_the_tapped_shader_has_the_bits_of_production(name: str, strategy: str) -> None:
    scene = scene_of(name)
    tap, renderer = Tap(scene, strategy, OURS), TracerRenderer(scene, strategy)
    try:
        left = tap.observe(look()).accumulated.reshape(SIZE[1], SIZE[0], 4)
        batch = renderer.render_batch(2, 7, 1)
        np.testing.assert_array_equal(left[..., :3], batch.mean)
        assert (left[..., 3] == 1).all()
    finally:
        tap.release()
        renderer.release()


def test_records_are_those_of_the_path_that_is_asked_for() -> None:
    """The second of two samples of a second pass, on top of what lay there."""
    tap = Tap(scene_of("spheres"), "mixture", OURS)
    try:
        before = np.full((SIZE[1], SIZE[0], 4), 0.5, dtype=np.float32)
        first, second = (tap.observe(look(samples=2, tapped=number, number=1, previous=before)) for number in (0, 1))
        assert (expected.uint32(first.paths["seed"][:, :2]) == 7).all()
        assert (expected.uint32(second.paths["seed"][:, :2]) == 8).all()
        np.testing.assert_array_equal(first.accumulated, second.accumulated)
        assert (second.accumulated[:, 3] == 2.5).all()
        assert set(first.paths) == set(PATH_RECORDS) and set(first.vertices[0]) == set(VERTEX_RECORDS)
    finally:
        tap.release()


def test_top_rows_come_first_and_numbers_are_the_published_ones() -> None:
    tap = Tap(scene_of("spheres"), "mixture", OURS)
    try:
        paths = tap.observe(look()).paths
        y, x = np.divmod(np.arange(SIZE[0] * SIZE[1]), SIZE[0])
        np.testing.assert_array_equal(paths["pixel"][:, :2], np.stack([x, SIZE[1] - 1 - y], axis=1))
        stream = expected.pixel_stream(x, SIZE[1] - 1 - y, 2)
        state = expected.seed(stream, 7)
        np.testing.assert_array_equal(expected.uint32(paths["seed"][:, 2:]), state)
        for step in range(2):  # those of the film; a path that escapes takes no others
            np.testing.assert_array_equal(paths["first"][:, step], expected.number(expected.advance(state, step)))
        assert not paths["generator"][:, :2].any()
    finally:
        tap.release()


def test_all_paths_can_be_put_to_one_moment() -> None:
    """And it is their own that is recorded."""
    tap = Tap(scene_of("motion_blur"), "mixture", OURS)
    try:
        drawn, held = tap.observe(look(), 1, (1.0, 2.0, 3.0)), tap.observe(look(moment=0.25), 1, (1.0, 2.0, 3.0))
        np.testing.assert_array_equal(drawn.paths["time"], held.paths["time"])
        assert len(np.unique(held.paths["pose"], axis=0)) == 1
    finally:
        tap.release()


def test_functions_are_told_by_their_types() -> None:
    assert types("vec3 f(vec3 a, out float b)") == ["vec3", "vec3", "out float"]
    assert types("void g()") == ["void"]
    assert '#include "path_tracer.frag"' in dict(tapped(scene_of("spheres"), "mixture", OURS).files)["tap/main.glsl"]
