"""Light sampling: directions to every shape that shines against their density, and the choice of a light."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from scipy import special

from harness.checks import shared_level
from harness.checks.chi2 import pearson, tabulate
from harness.checks.domains import Axis, Crowded
from harness.scene.lights import LEAST_SHARE, area, lights_sampled
from harness.scene.model import RGB, Camera, Material, Scene, Shape, ShapeKind, as_matrix
from harness.shader.scene.chunk import scene_chunk
from tests.support.tracer import evaluate

COUNT = 1 << 16
BLACK = Material((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0)
# It looks away from all lights, so that the scene's frame is its own.
AWAY = np.diag([-1.0, 1.0, -1.0, 1.0])
AWAY[2, 3] = -20.0
CAMERA = Camera(as_matrix(AWAY), 0.2, 0.2, 0.01, 1e4)


def placed(scale: Any = 1.0, turn: float = 0.0, at: Any = (0, 0, 0)) -> np.ndarray:
    """Scaled along its axes, turned about (1, 2, 2) / 3, and moved."""
    axis = np.array([1, 2, 2]) / 3
    cross = np.cross(np.eye(3), axis)
    rotation = np.eye(3) + np.sin(turn) * cross + (1 - np.cos(turn)) * cross @ cross
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.broadcast_to(scale, 3)
    matrix[:3, 3] = at
    return matrix


def light(kind: ShapeKind, matrix: np.ndarray, radiance: RGB = (1.0, 1.0, 1.0), **more: Any) -> Shape:
    return Shape(kind, as_matrix(matrix), BLACK, radiance, **more)


def scene_of(*shapes: Shape, environment: RGB = (0.0, 0.0, 0.0), shutter: tuple[float, float] = (0.0, 0.0)) -> Scene:
    return Scene(shapes, environment, dataclasses.replace(CAMERA, shutter=shutter), 4, 4, max_depth=3)


SHEARED = placed((0.6, 0.9, 1.0), 0.7, (0, 0, 2)) @ np.array([[1, 0.4, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
TURNING = as_matrix(placed(1.0, 1.1, (0.3, -0.2, 0.1)))
AT: Axis = (0.2, -0.1, -0.3)
# Lights with where they are seen from, about the direction in which they lie.
CASES: dict[str, tuple[Shape, Axis]] = {
    "ball": (light("sphere", placed(0.7, at=(0, 0, 2))), AT),
    "ball, touching": (light("sphere", placed(1.0, at=(0, 0, 1.31))), (0.0, 0.0, 0.3)),
    "ball, far and small": (light("sphere", placed(0.01, at=(3, -1, 5))), AT),
    "ball, from inside": (light("sphere", placed(2.0), flip_normals=True), AT),
    "rectangle": (light("rectangle", placed((0.5, 0.8, 1), 2.7, (0, 0, 2))), AT),
    "rectangle, flipped": (light("rectangle", placed((0.5, 0.8, 1), 0.4, (0, 0, 2)), flip_normals=True), AT),
    "parallelogram": (light("rectangle", SHEARED, flip_normals=True), AT),
    "oval": (light("disk", placed((0.5, 1.1, 1), 0.4, (0, 0, 2)), flip_normals=True), AT),
    "sheared disk": (light("disk", SHEARED, flip_normals=True), AT),
    "box": (light("cube", placed((0.4, 0.7, 0.5), 0.9, (0, 0, 2))), AT),
    "box, one face": (light("cube", placed((1.4, 1.7, 0.5), 0.0, (0, 0, 2))), AT),
    "box, sheared": (light("cube", SHEARED), AT),
    "box, mirrored": (light("cube", placed((-0.4, 0.7, 0.5), 0.9, (0, 0, 2))), AT),
    "box, from inside": (light("cube", placed((1.4, 1.7, 0.9), 0.4), flip_normals=True), AT),
    "tube": (light("cylinder", placed((0.4, 0.4, 1.3), 0.9, (0, 0, 2))), AT),
    "tube, close": (light("cylinder", placed((0.4, 0.4, 1.3), 0.0, (0, 0.5, -0.9))), (0.05, 0.05, -0.3)),
    "tube, from inside": (light("cylinder", placed((0.6, 0.6, 1.3), 0.0, (0.1, 0, -0.9)), flip_normals=True), AT),
    "tube, through its end": (light("cylinder", placed((0.5, 0.5, 0.7), 0.4, (0, 0, 0.6)), flip_normals=True), AT),
    "turning box": (light("cube", placed((0.4, 0.7, 0.5), 0.9, (0, 0, 2)), motion=TURNING), AT),
    "turning oval": (light("disk", placed((0.5, 1.1, 1), 0.4, (0, 0, 2)), flip_normals=True, motion=TURNING), AT),
    "sliding ball": (light("sphere", placed(0.5, at=(0, 0, 2)), motion=as_matrix(placed(at=(0.5, 0, 0)))), AT),
}
LEVEL = shared_level(1e-3, len(CASES))
TIME = 0.6  # of the shutter's interval
# Midpoints along a cell's side, by which a density that ends inside the cell is integrated: with 30 the quadrature adds
# less than 10 to any χ² of some 150 degrees of freedom, but 55 to that of a light that fills some ten cells, which has
# 60.
STEPS = {"ball, far and small": 60}
OTHER_STEPS = 30


def drawn(scene: Scene, o: Axis, numbers: np.ndarray, directions: np.ndarray | None = None,
          strategy: str = "mis") -> np.ndarray:
    """Of the probe lights.frag, (N, 12), for rows of numbers (N, 4): two of the direction, the map's, the choice."""
    count = len(numbers)
    rows = [np.tile([*o, 0.0], (count, 1)), np.tile([0.0, 0.0, 1.0, TIME], (count, 1)), np.zeros((count, 4)),
            np.zeros((count, 4))]
    rows[0][:, 3], rows[2][:, :3] = numbers[:, 3], numbers[:, :3]
    if directions is not None:
        rows[3][:, :3] = directions
    chunk = {"scene.glsl": scene_chunk(scene, strategy)}
    return evaluate("lights.frag", *rows, outputs=3, generated=chunk)


def uniform(count: int, seed: int = 1) -> np.ndarray:
    return np.floor(np.random.default_rng(seed).random((count, 4)) * 2**24) / 2**24


def moved(shape: Shape) -> dict[str, Any]:
    return {"shutter": (0.0, 1.0)} if shape.motion is not None else {}


def assert_even(shape: Shape, o: np.ndarray, points: np.ndarray) -> None:
    """Points (N, 3) on a tube's outside lie evenly in the arc that faces `o`, and along its height."""
    q, p = (at @ np.linalg.inv(shape.matrix)[:3, :3].T + np.linalg.inv(shape.matrix)[:3, 3] for at in (o, points))
    arc = np.arccos(1 / np.hypot(q[0], q[1]))
    around = np.arctan2(p[:, 1], p[:, 0]) - np.arctan2(q[1], q[0])
    around = (around + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(around).max() < arc * (1 + 1e-3)
    counts, _, _ = np.histogram2d(around / arc, p[:, 2], bins=(24, 16), range=((-1, 1), (0, 1)))
    statistic, dof = pearson(counts.ravel(), np.full(counts.size, counts.sum() / counts.size))
    assert special.chdtrc(dof, statistic) > LEVEL, f"χ²/dof {statistic / dof:.3g}"


@pytest.mark.parametrize(("name", "o"), [
    ("ball", (0.0, 0.0, 2.1)), ("ball, from inside", (0.0, 0.0, 3.0)), ("rectangle, flipped", (0.0, 0.0, 5.0)),
    ("box", (0.0, 0.0, 2.0)), ("box, from inside", (0.0, 0.0, 5.0)),
])
def test_dark_sides_are_not_sampled(name: str, o: Axis) -> None:
    """From inside what shines outwards, from outside what shines inwards, from behind: no direction has a density."""
    found = drawn(scene_of(CASES[name][0]), o, uniform(4096))
    assert (found[:, 3] == 0).all()


@pytest.mark.parametrize("name", CASES)
def test_directions_follow_their_density(name: str) -> None:
    """χ² over cells about the light, of those that see it; and the density that is told with a direction is the one
    that a ray which meets the light that way is told."""
    shape, o = CASES[name]
    scene = scene_of(shape, **moved(shape))
    found = drawn(scene, o, uniform(COUNT))
    l, pdf, least = found[:, :3], found[:, 3], found[:, 6]  # noqa: E741
    met, t, facing, density = found[:, 8], found[:, 9], found[:, 10], found[:, 11]
    np.testing.assert_allclose(np.linalg.norm(l, axis=1), 1, rtol=1e-6)
    lit = (pdf > 0) & (met == 0) & (t >= least) & (facing > 0)
    assert lit.mean() > 0.4
    # Rounding of the ray moves the point that it meets; at grazing angles the cosine there changes by as much.
    firm = lit & (facing > 0.01)
    np.testing.assert_allclose(pdf[firm], density[firm], rtol=3e-3)
    assert np.median(np.abs(pdf[firm] / density[firm] - 1)) < 2e-5

    def met_density(directions: np.ndarray) -> np.ndarray:
        return drawn(scene, o, np.zeros((len(directions), 4)), directions)[:, 11]

    if shape.kind == "cylinder" and not shape.flip_normals:
        # The density per steradian has no bound at its edges, where cells are no measure: per area it is even.
        assert lit.mean() > 0.99  # at the limb rounding misses, where next to nothing shines
        assert_even(shape, np.array(o), o + t[lit, None].astype(np.float64) * l[lit])
        return
    axis = l[lit].mean(axis=0)
    axis /= np.linalg.norm(axis)
    histogram = tabulate(l[lit].astype(np.float64), met_density, Crowded((axis[0], axis[1], axis[2])), (31, 15),
                         STEPS.get(name, OTHER_STEPS))
    expected = histogram.expected * (COUNT / lit.sum())
    assert histogram.observed.sum() == lit.sum()
    assert abs(expected.sum() - lit.sum()) < 0.01 * COUNT
    statistic, dof = pearson(histogram.observed.ravel(), expected.ravel())
    assert special.chdtrc(dof, statistic) > LEVEL, f"χ²/dof {statistic / dof:.3g}"


def test_corners_of_the_numbers() -> None:
    """0 and the largest below 1 are numbers like others: directions are unit vectors, densities are finite."""
    corner = np.array([0.0, 1 - 2**-24])
    numbers = np.stack(np.meshgrid(corner, corner, corner, corner), axis=-1).reshape(-1, 4)
    for shape, o in CASES.values():
        found = drawn(scene_of(shape, **moved(shape)), o, numbers)
        assert np.isfinite(found[:, :7]).all()
        np.testing.assert_allclose(np.linalg.norm(found[:, :3], axis=1), 1, rtol=1e-6)


SEVERAL = scene_of(light("sphere", placed(0.5, at=(0, 0, 2)), (3.0, 3.0, 3.0)),
                   light("rectangle", placed((0.5, 0.8, 1), 0.4, (2, 0, 2)), (0.0, 0.0, 0.0)),
                   light("cube", placed((0.4, 0.7, 0.5), 0.9, (-2, 0, 2)), (0.1, 0.5, 0.2)),
                   light("disk", placed(0.02, 0.4, (0, 2, 2)), (1.0, 1.0, 1.0)), environment=(0.2, 0.2, 0.2))


@pytest.mark.parametrize("strategy", ["nee", "mis"])
def test_lights_are_chosen_by_their_power(strategy: str) -> None:
    """As often as their chances say, which add up to 1; what sends out nothing never; a plain sky by `nee` alone."""
    lights = lights_sampled(SEVERAL, strategy)
    chances = {one.shape: one.chance for one in lights}
    assert set(chances) == {0, 2, 3, *([-1] if strategy == "nee" else [])}
    assert sum(chances.values()) == pytest.approx(1)
    assert min(chances.values()) > 0.9 * LEAST_SHARE / len(chances)
    powers = {0: 3.0 * area(SEVERAL.shapes[0]), 3: area(SEVERAL.shapes[3])}
    least = LEAST_SHARE / len(chances)
    assert (chances[0] - least) / (chances[3] - least) == pytest.approx(powers[0] / powers[3], rel=1e-6)
    found = drawn(SEVERAL, AT, uniform(COUNT), strategy=strategy)
    for shape, chance in chances.items():
        chosen = found[:, 4] == shape
        np.testing.assert_allclose(found[chosen, 5], chance, rtol=1e-6)
        assert chosen.mean() == pytest.approx(chance, abs=4 * np.sqrt(chance / COUNT))


def test_the_density_of_several_lights_has_their_chances() -> None:
    """What multiple importance sampling weighs by is the chance of the light times the density towards it."""
    found = drawn(SEVERAL, AT, uniform(COUNT))
    lit = (found[:, 3] > 0) & (found[:, 8] == found[:, 4]) & (found[:, 10] > 0.01)
    assert lit.mean() > 0.5
    np.testing.assert_allclose(found[lit, 11], found[lit, 3] * found[lit, 5], rtol=3e-3)
    directions = np.random.default_rng(3).normal(size=(4096, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    elsewhere = drawn(SEVERAL, AT, np.zeros((4096, 4)), directions)
    assert (elsewhere[np.isin(elsewhere[:, 8], [-1, 1]), 11] == 0).all()
