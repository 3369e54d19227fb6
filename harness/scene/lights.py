"""The lights of a scene as something to choose from: which shapes and which sky, their areas, and each one's chance.

A vertex samples one light, chosen by its power: the flux that it sends out, for the environment the flux that reaches
what is seen (Pharr, Jakob & Humphreys 2023, "Physically Based Rendering", 4th ed., section 12.6.2). Any chances are
right; these need few samples where lights differ.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.errors import HarnessError
from harness.samples.estimate import LUMINANCE
from harness.scene.bitmaps import bitmap_texels
from harness.scene.displaced import bounds
from harness.scene.frame import seen
from harness.scene.importance import mean_radiance
from harness.scene.model import RGB, Checkerboard, EnvironmentMap, Procedural, Scene, Shape, Texture, is_black

# Written out in the shader one by one. Of spheres, rectangles, disks, cubes and cylinders in turn, 64 take llvmpipe 2 s
# of CPU time to compile, 128 take 4.5 s and 0.5 GB, 256 take 10 s and 1 GB.
MOST_LIGHTS = 256
# Of shapes the index, of the environment this: what a ray that escapes has met.
ENVIRONMENT = -1
# What a light is chosen with at least, as a part of what it would be if all were alike: a power that is badly guessed
# (a bitmap's by its mean, whose bright texels may all face one surface) then costs noise and no more.
LEAST_SHARE = 0.05


@dataclass(frozen=True)
class Light:
    """`shape`: its index in the scene, or ENVIRONMENT. `chance`: the probability that a vertex samples it."""

    shape: int
    chance: float


def lights_sampled(scene: Scene, way: str) -> tuple[Light, ...]:
    """The lights that vertices choose from, brightest first; those that send out nothing are left out.

    `way`: how light is found. Where it is only `met`, none is sampled. Where it is met as well as sampled (`mis`), an
    environment of one radiance is not among them: directions drawn for the surface find it as often as they should, so
    that none needs less to be sampled. HarnessError for more than MOST_LIGHTS.
    """
    if way == "met":
        return ()
    powers = {index: mean(shape.emission) @ LUMINANCE * area(shape) for index, shape in enumerate(scene.shapes)
              if shape.emission is not None and not is_black(shape.emission)}
    if len(powers) > MOST_LIGHTS:
        raise HarnessError(f"scene '{scene.name}' has {len(powers)} lights; strategies that sample them take "
                           f"{MOST_LIGHTS} at most: use mixture, or join lights into fewer shapes")
    if isinstance(scene.environment, EnvironmentMap) or way == "nee":
        radiance = _environment_radiance(scene.environment)
        if radiance > 0:
            powers[ENVIRONMENT] = 4 * math.pi * radiance * _radius_seen(scene)**2
    total = sum(powers.values())
    shares = {index: power / total for index, power in powers.items()} if total > 0 else {}
    even = 1 / max(len(shares), 1)
    shares = {index: (1 - LEAST_SHARE) * share + LEAST_SHARE * even for index, share in shares.items()}
    return tuple(Light(index, share) for index, share in sorted(shares.items(), key=lambda item: -item[1]))


def area(shape: Shape) -> float:
    """A shape's area in square scene units; a displaced sphere's as if it were not."""
    x, y, z = shape.matrix[:3, :3].T
    match shape.kind:
        case "rectangle":
            return 4 * float(np.linalg.norm(np.cross(x, y)))
        case "disk":
            return math.pi * float(np.linalg.norm(np.cross(x, y)))
        case "cube":
            return 2 * float(sum(face_areas(shape)))
        case "cylinder":
            return 2 * math.pi * float(np.linalg.norm(x) * np.linalg.norm(z))
        case _:
            return 4 * math.pi * float(np.cbrt(abs(np.linalg.det(shape.matrix[:3, :3]))))**2


def face_areas(shape: Shape) -> Sequence[float]:
    """Of a cube, the areas of the faces across its x, y and z axes, one of each pair."""
    x, y, z = shape.matrix[:3, :3].T
    return [4 * float(np.linalg.norm(np.cross(*edges))) for edges in ((y, z), (z, x), (x, y))]


def reach(shape: Shape) -> float:
    """The radius of the ball that a sphere fills, or that a displaced one keeps within, in scene units."""
    radius = float(np.cbrt(abs(np.linalg.det(shape.matrix[:3, :3]))))
    return radius if shape.displacement is None else radius * bounds(shape.displacement).highest


def mean(texture: Texture | None) -> np.ndarray:
    """About the mean of a radiance over its surface, (3,): of a procedural texture that of its colours."""
    match texture:
        case None:
            return np.zeros(3)
        case Checkerboard():
            return np.mean([texture.color0, texture.color1], axis=0)
        case Procedural():
            return np.mean(texture.colors, axis=0)
        case tuple():
            return np.array(texture)
        case _:
            return np.asarray(bitmap_texels(texture).mean(axis=(0, 1), dtype=np.float64))


def _environment_radiance(environment: RGB | EnvironmentMap) -> float:
    radiance = mean_radiance(environment) if isinstance(environment, EnvironmentMap) else environment
    return float(np.array(radiance) @ LUMINANCE)


def _radius_seen(scene: Scene) -> float:
    """About the radius of what the camera sees, the far tenth left out."""
    points, _ = seen(scene)
    if not len(points):
        return 1.0
    return float(np.quantile(np.linalg.norm(points - np.median(points, axis=0), axis=1), 0.9)) or 1.0
