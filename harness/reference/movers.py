"""Shapes that move, to a renderer that meets each of them where it rests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from harness.scene.motion import Screw


@dataclass(frozen=True, eq=False)
class Mover:
    """A shape that moves: its index, its screw motion, and a scene in which it rests alone."""

    shape: int
    steady: Screw
    scene: Any

    def pose(self, mi: Any, moment: Any) -> tuple[Any, Any]:
        """Where it has come to at each moment, as `Screw.pose` has it: a Matrix3f and a Vector3f."""
        import drjit as dr

        turned = moment * self.steady.angle
        sine, versine = dr.sin(turned), 2.0 * dr.square(dr.sin(0.5 * turned))
        x, y, z = (float(value) for value in self.steady.axis)
        across = mi.Matrix3f([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        along_sine, along_versine = (mi.Vector3f(*map(float, part)) for part in self.steady.swing)
        turn = mi.Matrix3f(1) + sine * across + versine * (across @ across)
        return turn, moment * mi.Vector3f(*map(float, self.steady.slide)) + sine * along_sine + versine * along_versine


def scene_of(mi: Any, parts: list[Any]) -> Any:
    """A Mitsuba scene of these shapes and emitters."""
    return mi.load_dict({"type": "scene", **{f"part {number}": part for number, part in enumerate(parts)}})


def at_rest(mi: Any, ray: Any, turn: Any, shift: Any) -> Any:
    """A ray as a shape that the pose carries meets it where it rests."""
    back = turn.T
    carried = mi.Ray3f(ray)
    carried.o, carried.d = mi.Point3f(back @ (mi.Vector3f(ray.o) - shift)), back @ ray.d
    return carried


def turned_back(direction: Any, turn: Any) -> Any:
    """A direction in the space in which the shape rests; the same where nothing moves."""
    return direction if turn is None else turn.T @ direction
