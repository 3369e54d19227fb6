"""A patch of floor under lamps, and its irradiance by quadrature: what every way to sample lights must find."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import stats

from harness.scene.model import RGB, Camera, EnvironmentMap, Material, Scene, Shape, ShapeKind, as_matrix
from harness.shader.library import Library
from tests.support.tracer import TracerRenderer, library

PIXELS = 256
KD = 0.5
BLACK = Material((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0)
NOTHING = (0.0, 0.0, 0.0)
# Looks at the origin from so near that all lamps are behind it; a pixel sees a thousandth of a unit at most.
AT = np.array([-0.04, 0.0, 0.02])
VIEW = AT / np.linalg.norm(AT)
LEFT = np.array([0.0, 1.0, 0.0])
TO_WORLD = np.eye(4)
TO_WORLD[:3] = np.stack([LEFT, np.cross(-VIEW, LEFT), -VIEW, AT], axis=1)
CAMERA = Camera(as_matrix(TO_WORLD), 1e-3, 1e-3, 1e-4, 1e4)
CELLS = 400  # along either side of a surface that is integrated
Surface = Callable[[np.ndarray, np.ndarray], np.ndarray]


def placed(x: Any, y: Any, at: Any) -> np.ndarray:
    """(4, 4): the axes x and y, the one across both, and a place."""
    x, y = np.array(x, dtype=float), np.array(y, dtype=float)
    across = np.cross(x, y)
    matrix = np.eye(4)
    matrix[:3] = np.stack([x, y, across / np.linalg.norm(across), at], axis=1)
    return matrix


def lamp(kind: ShapeKind, matrix: np.ndarray, radiance: float, **more: Any) -> Shape:
    emission: RGB = (radiance, 2 * radiance, 0.5 * radiance)
    return Shape(kind, as_matrix(matrix), BLACK, emission if radiance else None, **more)


def floor(ks: float = 0.0, alpha: float = 1.0, size: float = 4.0) -> Shape:
    place = placed((size, 0, 0), (0, size, 0), (0, 0, 0))
    return Shape("rectangle", as_matrix(place), Material((KD,) * 3, (ks,) * 3, alpha))


def scene_of(*shapes: Shape, environment: RGB | EnvironmentMap = NOTHING, max_depth: int = 2,
             camera: Camera = CAMERA) -> Scene:
    return Scene(shapes, environment, camera, 16, 16, max_depth=max_depth)


def irradiance(surface: Surface, weight: Callable[[np.ndarray], np.ndarray] | None = None) -> float:
    """Of a surface of radiance 1, points (..., 3) over the unit square, at the origin, whose normal is z: by the
    midpoints of cells. `weight`: what each direction counts, beside its cosine. Sides that face away count as 0."""
    u, v = np.meshgrid(*[(np.arange(CELLS) + 0.5) / CELLS] * 2, indexing="ij")
    p, step = surface(u, v), 1e-5
    across = np.cross((surface(u + step, v) - surface(u - step, v)) / (2 * step),
                      (surface(u, v + step) - surface(u, v - step)) / (2 * step))
    t2 = (p * p).sum(axis=-1)
    d = p / np.sqrt(t2)[..., None]
    counted = np.maximum(d[..., 2], 0) * np.maximum(-(across * d).sum(axis=-1), 0) / t2
    return float((counted * (weight(d) if weight else 1)).mean())


def sheet(matrix: np.ndarray, *, flip: bool = False) -> Surface:
    """A rectangle's front, or its back."""
    def points(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        a, b = 2 * (v if flip else u)[..., None] - 1, 2 * (u if flip else v)[..., None] - 1
        return np.asarray(matrix[:3, 3] + a * matrix[:3, 0] + b * matrix[:3, 1])
    return points


def ball_above(center: Any, radius: float) -> float:
    """π r² cos θ / d²: a ball of radiance 1 that is above the horizon."""
    d2 = float(np.dot(center, center))
    return float(np.pi * radius**2 * center[2] / d2**1.5)


def measured(scene: Scene, strategy: str, samples: int, shader: Library | None = None) -> np.ndarray:
    """(PIXELS, 3): means of pixels that all see the same, by the library under test or by `shader`."""
    renderer = TracerRenderer(scene, strategy, (shader or library()).tracer(scene, strategy))
    try:
        batch = renderer.render_batch(0, 0, samples)
    finally:
        renderer.release()
    assert batch.rejected == 0
    return batch.mean.reshape(-1, 3).astype(np.float64)


# All comparisons of a file of tests raise a false alarm in one of a thousand changes of the seeds.
COMPARISONS = 90
LIMIT = float(stats.t.isf(1e-3 / (2 * COMPARISONS), PIXELS - 1))


def assert_mean(pixels: np.ndarray, exact: np.ndarray, noise: float) -> None:
    """Their mean is `exact`, (3,), to LIMIT standard errors of which each is at most the part `noise` of it."""
    error = pixels.std(axis=0, ddof=1) / np.sqrt(len(pixels))
    assert (error < noise * exact).all(), f"standard errors {error / exact} where {noise} is due"
    away = (pixels.mean(axis=0) - exact) / np.maximum(error, 1e-5 * exact)
    assert (abs(away) < LIMIT).all(), f"{pixels.mean(axis=0) / exact - 1} off, {away} standard errors"


def of_lamps(value: float) -> np.ndarray:
    """In the colour of lamps."""
    return value * np.array([1, 2, 0.5])


UNDER = placed((1, 0, 0), (0, -1, 0), (0.2, 0.3, 1.6))  # looks down, as all that follow
SMALL = placed((0.2, 0, 0), (0, -0.2, 0), (0.1, 0.1, 0.8))
ASIDE = placed((0.4, 0, 0.3), (0, -0.5, 0), (-1.6, 0.2, 1.0))
COVER = placed((1.0, 0, 0), (0, 1.0, 0), (-1.4, 1.2, 0.5))


@functools.cache
def lamps() -> tuple[Scene, float]:
    """A small lamp before a large one, a ball, a box, a lamp half covered by what is dark, others dark from here: one
    turned away, one behind a lamp, and what is dark behind that; and the irradiance."""
    ball, box = (0.9, -1.0, 0.6), (1.7, 0.1, 1.2)
    away = placed((0.3, 0, 0), (0, 0.3, 0), (0.3, -1.4, 0.3))
    behind = placed((0.6, 0, 0), (0, -0.6, 0), (0.2, 0.3, 1.9))
    scene = scene_of(
        floor(), lamp("rectangle", UNDER, 1.0), lamp("rectangle", SMALL, 4.0), lamp("rectangle", ASIDE, 2.0),
        lamp("rectangle", COVER, 0.0), lamp("sphere", placed((0.3, 0, 0), (0, 0.3, 0), ball) * ([1, 1, 0.3, 1]), 3.0),
        lamp("cube", placed((0.3, 0, 0), (0, 0.2, 0), box) * ([1, 1, 0.4, 1]), 2.0), lamp("rectangle", away, 9.0),
        lamp("rectangle", behind, 2.0), lamp("rectangle", placed((5, 0, 0), (0, 5, 0), (0, 0, 2.5)), 0.0))

    def covered(d: np.ndarray) -> np.ndarray:
        at = d[..., :2] * (COVER[2, 3] / np.maximum(d[..., 2:], 1e-9)) - COVER[:2, 3]
        return np.asarray(~(abs(at) < 1).all(axis=-1), dtype=float)

    # The origin lies between the planes of its sides along y: two faces are seen.
    faces = [placed((0, 0, 0.4), (0, 0.2, 0), (1.4, 0.1, 1.2)), placed((0.3, 0, 0), (0, -0.2, 0), (1.7, 0.1, 0.8))]
    box_seen = sum(irradiance(sheet(face)) for face in faces)
    little = irradiance(sheet(SMALL))
    return scene, (irradiance(sheet(UNDER)) - little + 4 * little + 2 * irradiance(sheet(ASIDE), covered)
                   + 3 * ball_above(ball, 0.3) + 2 * box_seen)


@functools.cache
def by_a_wall() -> tuple[Scene, float]:
    """A ball of light below a small floor, which sees it by a wall alone: two bounces, of which the second has other
    densities than the first; and the irradiance."""
    center, radius, albedo = np.array([0.1, 0.0, -0.7]), 0.6, 0.9
    matrix = placed((0, 0, 0.4), (0, 1.0, 0), (0.8, 0.0, 0.5))

    def lit(d: np.ndarray) -> np.ndarray:
        to_ball = center - d * (matrix[0, 3] / np.maximum(d[..., :1], 1e-9))
        return np.asarray(albedo * radius**2 * -to_ball[..., 0] / (to_ball**2).sum(axis=-1)**1.5)

    wall = Shape("rectangle", as_matrix(matrix), Material((albedo,) * 3, NOTHING, 1.0))
    bulb = lamp("sphere", placed((radius, 0, 0), (0, radius, 0), center) * [1, 1, radius, 1], 1.0)
    return scene_of(floor(size=0.05), wall, bulb, max_depth=3), irradiance(sheet(matrix), lit)
