"""Camera rays against Mitsuba's `perspective` sensor, for every way of giving its field of view."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from harness.shader.scene.chunk import scene_chunk
from tests.support.tracer import evaluate

DIRECTION_TOLERANCE = 5e-7
ORIGIN_TOLERANCE = 1e-6
LOOKAT = '<transform name="to_world"><lookat origin="1.5, 0.7, -2" target="-0.3, 0.2, 1" up="0.1, 1, 0.2"/></transform>'


def sensor(properties: str, width: int, height: int, to_world: str = LOOKAT) -> str:
    """A sensor element with the given properties and film size."""
    return (f'<sensor type="perspective">{to_world}{properties}<film type="hdrfilm"><rfilter type="box"/>'
            f'<integer name="width" value="{width}"/><integer name="height" value="{height}"/></film></sensor>')


def assert_same_rays(mi: Any, scene: Any, element: str) -> None:
    """Origins, directions and lengths agree with Mitsuba's all over the film, corners included."""
    loaded = scene(sensor=element)
    edge = np.linspace(0, 1, 17, dtype=np.float32)
    x, from_top = (grid.ravel() for grid in np.meshgrid(edge, edge))
    ray, _ = mi.load_file(str(loaded.path)).sensors()[0].sample_ray(
        0, 0, mi.Point2f(x, from_top), mi.Point2f(0.5, 0.5))
    film = np.zeros((len(x), 4))
    film[:, 0], film[:, 1] = x, 1 - from_top
    found = evaluate("camera.frag", film, outputs=2, generated={"scene.glsl": scene_chunk(loaded, "cosine")})
    np.testing.assert_allclose(found[:, 4:7], np.array(ray.d).T, rtol=0, atol=DIRECTION_TOLERANCE)
    np.testing.assert_allclose(found[:, :3], np.array(ray.o).T, rtol=0, atol=ORIGIN_TOLERANCE)
    np.testing.assert_allclose(found[:, 3], np.array(ray.maxt), rtol=2e-6)


@pytest.mark.parametrize("size", [(64, 36), (36, 64), (50, 50)], ids=["landscape", "portrait", "square"])
@pytest.mark.parametrize("axis", ["x", "y", "diagonal", "smaller", "larger", None])
def test_field_of_view_is_measured_on_its_axis(mi: Any, scene: Any, axis: str | None, size: tuple[int, int]) -> None:
    """Every `fov_axis` on every aspect, and the default axis."""
    named = f'<string name="fov_axis" value="{axis}"/>' if axis else ""
    assert_same_rays(mi, scene, sensor(f'<float name="fov" value="57.3"/>{named}', *size))


@pytest.mark.parametrize("size", [(64, 36), (36, 64)], ids=["landscape", "portrait"])
@pytest.mark.parametrize("given", ["", '<string name="focal_length" value="35mm"/>',
                                   '<string name="focal_length" value="85"/>'])
def test_focal_length_is_that_of_35_mm_film(mi: Any, scene: Any, given: str, size: tuple[int, int]) -> None:
    """A focal length, with and without its unit, and Mitsuba's default where neither it nor `fov` is given."""
    assert_same_rays(mi, scene, sensor(given, *size))


@pytest.mark.parametrize("offset", [(0.25, 0.0), (0.0, 0.25), (-0.4, 0.15)])
def test_principal_point_moves_the_film(mi: Any, scene: Any, offset: tuple[float, float]) -> None:
    """Offsets in both directions, with Mitsuba's signs, on a film that is not square."""
    assert_same_rays(mi, scene, sensor(
        f'<float name="fov" value="40"/><float name="principal_point_offset_x" value="{offset[0]}"/>'
        f'<float name="principal_point_offset_y" value="{offset[1]}"/>', 64, 36))


@pytest.mark.parametrize(("near", "far"), [(0.01, 10000), (0.5, 3), (2, 2.5)])
def test_clip_planes_bound_the_ray(mi: Any, scene: Any, near: float, far: float) -> None:
    """Rays start on the near plane and reach to the far plane: planes, not spheres."""
    assert_same_rays(mi, scene, sensor(f'<float name="fov" value="70"/><float name="near_clip" value="{near}"/>'
                                       f'<float name="far_clip" value="{far}"/>', 40, 30))


@pytest.mark.parametrize("to_world", [
    "",
    '<transform name="to_world"><rotate x="1" angle="30"/><rotate y="0.6" z="0.8" angle="-110"/>'
    '<translate x="3" y="-2" z="1"/></transform>',
    '<transform name="to_world"><scale x="-1"/></transform>',
], ids=["none", "rotated", "mirrored"])
def test_camera_stands_where_its_transform_puts_it(mi: Any, scene: Any, to_world: str) -> None:
    """Without a transform, under composed rotations, and mirrored, as left-handed exports have it."""
    assert_same_rays(mi, scene, sensor('<float name="fov" value="40"/>', 40, 30, to_world))
