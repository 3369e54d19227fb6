"""Paths that sample lights, against irradiances by quadrature: a patch of floor under lamps, and closed rooms.

Each strategy must find the same radiance, whatever part of it the rays to lights bring and whatever the path meets by
itself: a light counted twice, a weight of one side alone, a shadow that is missing and a bounce too few all move it.
"""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.scene.model import Displacement, Material, Procedural, Scene, Shape, as_matrix
from tests.support.lamps import (
    BLACK,
    CAMERA,
    KD,
    NOTHING,
    VIEW,
    assert_mean,
    ball_above,
    by_a_wall,
    floor,
    irradiance,
    lamp,
    lamps,
    measured,
    of_lamps,
    placed,
    scene_of,
    sheet,
)
from tests.support.scenes import SceneWriter


@pytest.mark.parametrize(("strategy", "noise"), [("nee", 6e-3), ("mis", 4e-3), ("cosine+mis-power", 3e-3)])
def test_a_floor_under_many_lamps(strategy: str, noise: float) -> None:
    """Choice, density, shadows and weights at once."""
    scene, received = lamps()
    assert_mean(measured(scene, strategy, 1024), of_lamps(KD / np.pi * received), noise)


@functools.cache
def tube() -> tuple[Scene, float]:
    """A tube that shines inwards, seen from beside: its outside hides most of the inside."""
    low, high, radius, x = 1.2, 1.8, 0.5, 0.8

    def wall(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        turn = 2 * np.pi * v  # the normal points inwards
        return np.stack([x + radius * np.cos(turn), radius * np.sin(turn), low + (high - low) * u], axis=-1)

    def through_the_end(d: np.ndarray) -> np.ndarray:
        at = d * (low / np.maximum(d[..., 2:], 1e-9))
        return np.asarray(np.hypot(at[..., 0] - x, at[..., 1]) < radius, dtype=float)

    matrix = np.diag([radius, radius, high - low, 1.0])
    matrix[:3, 3] = x, 0, low
    return (scene_of(floor(), lamp("cylinder", matrix, 1.0, flip_normals=True)), irradiance(wall, through_the_end))


@pytest.mark.parametrize("strategy", ["nee", "mis"])
def test_a_tube_is_not_seen_through(strategy: str) -> None:
    scene, received = tube()
    assert_mean(measured(scene, strategy, 1024), of_lamps(KD / np.pi * received), 5e-3)


@functools.cache
def passing() -> tuple[Scene, float]:
    """A lamp that moves while the shutter is open, over a floor that mirrors it in a lobe; and the radiance."""
    start = placed((0.3, 0, -0.2), (0, -0.4, 0), (1.2, -0.3, 1.0))
    shift = np.eye(4)
    shift[:3, 3] = -0.5, 0.8, 0.3
    ks, alpha = 0.4, 12.0
    mirror = VIEW * [-1, -1, 1]

    def reflected(d: np.ndarray) -> np.ndarray:
        return KD / np.pi + ks * (alpha + 1) / (2 * np.pi) * np.maximum(d @ mirror, 0)**alpha

    nodes, weights = np.polynomial.legendre.leggauss(8)
    seen = 0.0
    for node, weight in zip(nodes, weights, strict=True):
        there = start.copy()
        there[:3, 3] += (node + 1) / 2 * shift[:3, 3]
        seen += weight / 2 * irradiance(sheet(there), reflected)
    moving = lamp("rectangle", start, 1.0, motion=as_matrix(shift))
    return (scene_of(floor(ks, alpha), moving, camera=dataclasses.replace(CAMERA, shutter=(0.0, 1.0))), seen)


@pytest.mark.parametrize("strategy", ["nee", "mis"])
def test_a_moving_lamp_over_a_glossy_floor(strategy: str) -> None:
    scene, seen = passing()
    assert_mean(measured(scene, strategy, 1024), of_lamps(seen), 3e-3)


@pytest.mark.parametrize("strategy", ["nee", "mis"])
def test_a_floor_lit_by_a_wall(strategy: str) -> None:
    """Densities and weights are those of each vertex."""
    scene, received = by_a_wall()
    assert_mean(measured(scene, strategy, 4096), of_lamps(KD / np.pi * received), 6e-3)


DEPTH = 4
ALBEDO = np.array([0.5, 0.7, 0.3])
ROOM = Shape("cube", as_matrix(np.diag([2.0, 3.0, 2.5, 1.0])), Material((0.5, 0.7, 0.3), NOTHING, 1.0), (1.0, 2.0, 0.5),
             flip_normals=True)
PLAIN = Procedural("fractal", ((0.5, 0.5, 0.5), (0.5, 0.5, 0.5)), 1, 2.0, 0.5, 1.0, 0.0, 0, as_matrix(np.eye(4)))
# All of a sphere's surface lifted by half its radius: a sphere, to which rays march all the same.
LIFTED = Displacement(PLAIN, 1.0)


@pytest.mark.parametrize("marched", [False, True], ids=["met", "marched"])
@pytest.mark.parametrize("strategy", ["nee", "mis"])
def test_a_room_whose_walls_shine_and_reflect(strategy: str, marched: bool) -> None:
    """Radiance Σ ρ^k over as many bounces as max_depth allows, and the wall itself at the first vertex. The same where
    a displaced sphere stands outside, so that every ray is a march."""
    outside = placed((1, 0, 0), (0, 1, 0), (0, 0, 9))
    beyond = [Shape("displacedsphere", as_matrix(outside), BLACK, displacement=LIFTED)] if marched else []
    exact = np.array([1.0, 2.0, 0.5]) * sum(ALBEDO**k for k in range(DEPTH))
    assert_mean(measured(scene_of(ROOM, *beyond, max_depth=DEPTH), strategy, 256), exact, 2e-3)


@pytest.mark.parametrize("strategy", ["nee", "mis"])
def test_a_displaced_lamp(strategy: str) -> None:
    """A ball of 1.5 times its radius; the floor is dark where its shadow lies, and reaches no light from behind."""
    center = (0.9, 0.2, 1.1)
    bulb = lamp("displacedsphere", placed((0.3, 0, 0), (0, 0.3, 0), center) * ([1, 1, 0.3, 1]), 1.0,
                displacement=LIFTED)
    exact = of_lamps(KD / np.pi * ball_above(center, 0.45))
    assert_mean(measured(scene_of(floor(), bulb), strategy, 512), exact, 2e-3)


def test_a_floor_under_a_plain_sky() -> None:
    """`nee` samples it by the cosine, of which nothing but rounding is left; what escapes then has been sampled."""
    sky = (1.0, 2.0, 0.5)
    assert_mean(measured(scene_of(floor(), environment=sky, max_depth=3), "nee", 16), KD * np.array(sky), 1e-6)


@pytest.mark.parametrize("strategy", ["nee", "mis"])
@pytest.mark.parametrize("marched", [False, True], ids=["met", "marched"])
def test_a_floor_under_a_map(mi: Any, scene: SceneWriter, tmp_path: Path, strategy: str, marched: bool) -> None:
    """Rings of light about the zenith, linear between rows, one of them bright."""
    rows = np.array([0.5, 1.0, 8.0, 0.2, 1.0, 3.0, 2.0])
    texels = np.repeat(rows[:, None, None], 4, axis=1) * np.array([1, 2, 0.5])
    mi.Bitmap(texels.astype(np.float32)).write(str(tmp_path / "map.exr"))
    sky = scene('<emitter type="envmap"><string name="filename" value="map.exr"/><transform name="to_world">'
                '<rotate x="1" angle="90"/></transform></emitter>').environment
    theta = (np.arange(20000) + 0.5) / 20000 * np.pi / 2
    radiance = np.interp(theta, np.arange(len(rows)) / (len(rows) - 1) * np.pi, rows)
    received = 2 * np.pi * float((radiance * np.cos(theta) * np.sin(theta)).mean()) * np.pi / 2
    below = placed((1, 0, 0), (0, 1, 0), (0, 0, -9))
    beyond = [Shape("displacedsphere", as_matrix(below), BLACK, displacement=LIFTED)] if marched else []
    found = measured(scene_of(floor(), *beyond, environment=sky, max_depth=3), strategy, 512)
    assert_mean(found, of_lamps(KD / np.pi * received), 3e-3)
