"""Rays of the thin lens against Mitsuba's `thinlens`, sample by sample, and its points against the uniform disk."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from scipy import stats

from harness.scene import Scene, present
from harness.shader.scene.chunk import scene_chunk
from tests.support.tracer import evaluate

TOLERANCE = 3e-6  # of directions, and of origins some units from the world's: a few float32 spacings
SAMPLES = 5000
LOOKAT = '<transform name="to_world"><lookat origin="1.5, 0.7, -2" target="-0.3, 0.2, 1" up="0.1, 1, 0.2"/></transform>'


def sensor(properties: str, width: int = 64, height: int = 36, to_world: str = LOOKAT) -> str:
    """A `thinlens` element with the given properties and film size."""
    return (f'<sensor type="thinlens">{to_world}{properties}<film type="hdrfilm"><rfilter type="box"/>'
            f'<integer name="width" value="{width}"/><integer name="height" value="{height}"/></film></sensor>')


def lens(radius: float, focus: float | None = 3.0) -> str:
    """The two properties that make a lens."""
    given = "" if focus is None else f'<float name="focus_distance" value="{focus}"/>'
    return f'<float name="aperture_radius" value="{radius}"/>{given}'


def numbers(seed: int = 1, count: int = SAMPLES) -> np.ndarray:
    """Film and lens samples, (count + 5, 4): random ones, and the corners and the middle of the lens's square."""
    rng = np.random.default_rng(seed)
    corners = [[0.5, 0.5, x, y] for x in (0, 1) for y in (0, 1)]
    return np.float32([*rng.random((count, 4)), *corners, [0.5, 0.5, 0.5, 0.5]])


def rays(scene: Scene, samples: np.ndarray) -> np.ndarray:
    """The tracer's rays, (N, 8): origin, reach, direction, 0; film samples counted from the top left, as in Mitsuba."""
    flipped = samples * [1, -1, 1, 1] + [0, 1, 0, 0]
    return evaluate("camera.frag", flipped, outputs=2, generated={"scene.glsl": scene_chunk(scene, "cosine")})


def assert_same_rays(mi: Any, scene: Any, element: str) -> None:
    """Origins, directions and lengths agree with Mitsuba's for the same numbers."""
    loaded = scene(sensor=element)
    samples = numbers()
    ray, _ = mi.load_file(str(loaded.path)).sensors()[0].sample_ray(
        0, 0, mi.Point2f(samples[:, :2].T), mi.Point2f(samples[:, 2:].T))
    found = rays(loaded, samples)
    np.testing.assert_allclose(found[:, 4:7], np.array(ray.d).T, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(found[:, :3], np.array(ray.o).T, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(found[:, 3], np.array(ray.maxt), rtol=2e-6)


@pytest.mark.parametrize("size", [(64, 36), (36, 64), (50, 50)], ids=["landscape", "portrait", "square"])
@pytest.mark.parametrize("axis", ["x", "y", "diagonal", "smaller", "larger", None])
def test_field_of_view_is_measured_on_its_axis(mi: Any, scene: Any, axis: str | None, size: tuple[int, int]) -> None:
    """Every `fov_axis` on every aspect: the plane of focus scales with the film."""
    named = f'<string name="fov_axis" value="{axis}"/>' if axis else ""
    assert_same_rays(mi, scene, sensor(f'{lens(0.2)}<float name="fov" value="57.3"/>{named}', *size))


@pytest.mark.parametrize("radius", [1e-4, 0.05, 1.7])
@pytest.mark.parametrize("focus", [0.05, 3.0, 400.0, None], ids=lambda focus: f"focus {focus}")
def test_aperture_and_focus(mi: Any, scene: Any, radius: float, focus: float | None) -> None:
    """From a pinhole to a lens wider than its distance of focus, and Mitsuba's default distance, the far plane."""
    assert_same_rays(mi, scene, sensor(lens(radius, focus)))


@pytest.mark.parametrize(("near", "far"), [(0.01, 10000), (0.5, 3), (2, 2.5)])
def test_clip_planes_bound_the_ray(mi: Any, scene: Any, near: float, far: float) -> None:
    """Rays start on the near plane, not on the lens, and reach to the far plane."""
    assert_same_rays(mi, scene, sensor(f'{lens(0.3)}<float name="near_clip" value="{near}"/>'
                                       f'<float name="far_clip" value="{far}"/>'))


@pytest.mark.parametrize("to_world", ["", '<transform name="to_world"><scale x="-1"/></transform>'],
                         ids=["none", "mirrored"])
def test_the_lens_stands_where_the_camera_does(mi: Any, scene: Any, to_world: str) -> None:
    """Its disk is spanned by the camera's own left and up."""
    assert_same_rays(mi, scene, sensor(lens(0.3), to_world=to_world))


def test_lens_points_are_uniform_on_their_disk(scene: Any) -> None:
    """On the film's middle, rays leave a lens of radius 2: r² and the angle are uniform, by Kolmogorov and Smirnov."""
    loaded = scene(sensor=sensor(f'{lens(2, 5)}<float name="near_clip" value="1e-6"/>', to_world=""))
    samples = numbers(seed=2, count=40000)[:40000]
    samples[:, :2] = 0.5
    origins = rays(loaded, samples)[:, :2].astype(np.float64)
    radius = np.hypot(*origins.T)
    assert radius.max() <= 2 * (1 + 1e-5)
    for values in ((radius / 2) ** 2, np.arctan2(*origins.T) / (2 * np.pi) + 0.5):
        assert stats.kstest(np.clip(values, 0, 1), "uniform").pvalue > 1e-3


def test_rays_of_a_pixel_meet_in_the_plane_of_focus(scene: Any) -> None:
    """One point of the film, many of the lens: one point at depth 5."""
    loaded = scene(sensor=sensor(lens(0.8, 5), to_world=""))
    samples = numbers()
    samples[:, :2] = [0.2, 0.7]
    found = rays(loaded, samples).astype(np.float64)
    o, d = found[:, :3], found[:, 4:7]
    meeting = o + d * ((5 - o[:, 2]) / d[:, 2])[:, None]
    np.testing.assert_allclose(meeting, np.broadcast_to(meeting[0], meeting.shape), atol=5e-6)


def test_an_aperture_of_0_is_a_pinhole(mi: Any, scene: Any) -> None:
    """Mitsuba puts 6e-8 in its place: the rays of `perspective`, in both, and a note that says so."""
    element = sensor(lens(0))
    loaded = scene(sensor=element)
    assert re.search("aperture_radius 0: a pinhole", present(loaded.file).notes[0])
    assert "HAS_LENS 0" in scene_chunk(loaded, "cosine")
    assert_same_rays(mi, scene, element)
    plain = scene(sensor=re.sub("thinlens", "perspective", sensor("")))
    np.testing.assert_array_equal(rays(loaded, numbers()), rays(plain, numbers()))


def test_only_a_lens_costs_something(scene: Any) -> None:
    """The scene's text without a lens has neither its constants nor its switch set."""
    chunk = scene_chunk(scene(sensor=re.sub("thinlens", "perspective", sensor(""))), "cosine")
    assert "HAS_LENS 0" in chunk and "APERTURE" not in chunk
