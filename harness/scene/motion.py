"""Motion of shapes: a rigid transform and its powers, the screw motion that passes through it."""

from __future__ import annotations

import dataclasses
import functools
import math
from dataclasses import dataclass

import numpy as np

from harness.scene.model import Matrix, Scene, as_matrix
from harness.scene.nodes import Node

# How far a rotation's columns may be from orthonormal, as for a sensor: angles written with five digits.
RIGIDITY = 1e-4
# Radians from a half turn within which it does not tell which way it went.
HALF_TURN_MARGIN = 1e-5
# Turns by less (radians) are below the spacing of float32 at 1, and are taken for none.
SMALLEST_TURN = 1e-7
# Parts of a unit axis below this are what rounding left of zeros, which is not the same on every processor.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Screw:
    """A steady rigid motion: p(t) = exp(t ξ) p(0), the rotation about an axis with a slide along it.

    `axis`: unit, (3,); `angle`: radians in a unit of time, from 0 to less than π; `velocity`: the linear part of the
    twist ξ, (3,), scene units in a unit of time. Murray, Li & Sastry 1994, "A Mathematical Introduction to Robotic
    Manipulation", chapter 2, section 3, with ξ = (`velocity`, `angle` · `axis`).
    """

    axis: np.ndarray
    angle: float
    velocity: np.ndarray

    @property
    def slide(self) -> np.ndarray:
        """The part of the shift that grows with t: all of it where nothing turns, else that along the axis, (3,)."""
        return self.axis * (self.axis @ self.velocity) if self.angle else self.velocity

    @property
    def swing(self) -> tuple[np.ndarray, np.ndarray]:
        """The parts of the shift that grow with sin(t angle) and 1 - cos(t angle), (3,) both; zero if nothing turns."""
        if not self.angle:
            return np.zeros(3), np.zeros(3)
        return (self.velocity - self.slide) / self.angle, np.cross(self.axis, self.velocity) / self.angle

    def pose(self, time: float) -> np.ndarray:
        """The motion's `time`-th power, (4, 4), by Rodrigues' formula."""
        turn = time * self.angle
        sine, versine = math.sin(turn), 2 * math.sin(turn / 2) ** 2
        across = _cross_matrix(self.axis)
        along_sine, along_versine = self.swing
        pose = np.eye(4)
        pose[:3, :3] += sine * across + versine * across @ across
        pose[:3, 3] = time * self.slide + sine * along_sine + versine * along_versine
        return pose


@functools.cache
def screw(motion: Matrix) -> Screw:
    """The screw motion that reaches `motion`, a rigid transform, at time 1, turning by less than a half turn."""
    matrix = np.array(motion, dtype=np.float64)
    rotation, shift = matrix[:3, :3], matrix[:3, 3]
    twice_sine = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0],
                           rotation[1, 0] - rotation[0, 1]])
    angle = math.atan2(float(np.linalg.norm(twice_sine)), float(np.trace(rotation)) - 1)
    if angle < SMALLEST_TURN:
        return Screw(np.array([0.0, 0.0, 1.0]), 0.0, shift)
    axis = twice_sine / np.linalg.norm(twice_sine)
    axis[np.abs(axis) < ROUNDING] = 0.0
    across = _cross_matrix(axis)
    # The integral of the rotation over the unit of time takes the velocity to the shift.
    integral = (np.eye(3) + (1 - math.cos(angle)) / angle * across
                + (angle - math.sin(angle)) / angle * across @ across)
    return Screw(axis, angle, np.linalg.solve(integral, shift))


def load_motion(node: Node) -> Matrix | None:
    """The property `motion` of a shape; None where it is absent, or the identity. Refuses what is not rigid."""
    matrix = node.transform("motion")
    linear = matrix[:3, :3]
    if not np.allclose(linear.T @ linear, np.eye(3), rtol=0, atol=RIGIDITY) or np.linalg.det(linear) < 0:
        raise node.error("'motion' must be rigid, that is rotate and translate only, without scale, shear or mirror; "
                         "a rotation's axis must have length 1")
    left, _, right = np.linalg.svd(linear)
    matrix[:3, :3] = left @ right  # the nearest rotation
    if np.trace(left @ right) < 1 + 2 * math.cos(math.pi - HALF_TURN_MARGIN):
        raise node.error("'motion' turns by 180 degrees in a unit of time, which is the same for either direction; "
                         "turn by less, and keep the shutter open for longer")
    motion = as_matrix(matrix)
    steady = screw(motion)
    return motion if steady.angle or steady.velocity.any() else None


def moving(scene: Scene) -> tuple[int, ...]:
    """Indices of the shapes that move while the shutter is open; none where that is for a single moment."""
    opens, closes = scene.camera.shutter
    return tuple(i for i, shape in enumerate(scene.shapes) if shape.motion is not None and opens < closes)


def settled(scene: Scene) -> Scene:
    """The scene without motion, each shape where it is when the shutter opens, where that is for a single moment.

    Else the scene itself.
    """
    opens, closes = scene.camera.shutter
    if opens < closes or all(shape.motion is None for shape in scene.shapes):
        return scene
    return dataclasses.replace(scene, shapes=tuple(
        shape if shape.motion is None else dataclasses.replace(
            shape, to_world=as_matrix(screw(shape.motion).pose(opens) @ shape.matrix), motion=None)
        for shape in scene.shapes))


def _cross_matrix(axis: np.ndarray) -> np.ndarray:
    """The (3, 3) matrix A with A v = axis x v."""
    x, y, z = axis
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
