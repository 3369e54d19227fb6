"""GLSL for shapes that move: their poses at a path's time, and the ways into and out of a shape's rest frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from harness.scene.model import Matrix, Scene
from harness.scene.motion import moving, screw
from harness.shader.scene.literals import function, is_any, number, vector


@dataclass(frozen=True)
class Motions:
    """The distinct motions of a scene, each with the ids of the shapes that it carries; empty where nothing moves.

    Shapes that share a motion share its pose and the ray in its rest frame.
    """

    shapes: tuple[tuple[Matrix, tuple[int, ...]], ...]
    shutter: tuple[float, float]

    @classmethod
    def of(cls, scene: Scene) -> Motions:
        """Those of the shapes that move while the scene's shutter is open."""
        carried: dict[Matrix, list[int]] = {}
        for index in moving(scene):
            motion = scene.shapes[index].motion
            assert motion is not None
            carried.setdefault(motion, []).append(index)
        return cls(tuple((motion, tuple(ids)) for motion, ids in carried.items()), scene.camera.shutter)

    def declarations(self) -> list[str]:
        """`set_time`, called with a number in [0, 1) for each path; `to_rest` of points, `from_rest` of normals."""
        if not self.shapes:
            return []
        opens, closes = self.shutter
        lines = ['#include "lib/motion.glsl"', ""]
        lines += [f"Pose pose_{index};" for index in self._turning()]
        body = [f"path_time = {number(opens)} + {number(closes - opens)} * u;"]
        for index in self._turning():
            steady = screw(self.shapes[index][0])
            sine, versine = steady.swing
            body.append(f"pose_{index} = screw_pose({vector(steady.axis)}, {number(steady.angle / math.tau)}, "
                        f"{vector(steady.slide)}, {vector(sine)}, {vector(versine)});")
        return [*lines, *function("void set_time(float u)", body), *self._ways()]

    def rays(self) -> list[str]:
        """Statements that carry the ray (o, d) into each motion's rest frame."""
        lines = []
        for index, (motion, _) in enumerate(self.shapes):
            if index in self._turning():
                lines += [f"vec3 o_{index} = (o - pose_{index}.shift) * pose_{index}.turn;",
                          f"vec3 d_{index} = d * pose_{index}.turn;"]
            else:
                lines.append(f"vec3 o_{index} = o - path_time * {vector(screw(motion).velocity)};")
        return lines

    def ray(self, shape: int) -> str:
        """Origin and direction of the ray as shape `shape` meets it at rest, as arguments."""
        for index, (_, ids) in enumerate(self.shapes):
            if shape in ids:
                return f"o_{index}, d_{index}" if index in self._turning() else f"o_{index}, d"
        return "o, d"

    def _turning(self) -> list[int]:
        return [index for index, (motion, _) in enumerate(self.shapes) if screw(motion).angle]

    def _ways(self) -> list[str]:
        if not self._turning():
            body = [f"{_where(ids)}p -= path_time * {vector(screw(motion).velocity)};" for motion, ids in self.shapes]
            return [*function("vec3 to_rest(int id, vec3 p)", [*body, "return p;"]),
                    *function("vec3 from_rest(int id, vec3 n)", ["return n;"])]
        select = ["Pose pose = Pose(mat3(1.0), vec3(0.0));"]
        for index, (motion, ids) in enumerate(self.shapes):
            value = f"pose = pose_{index}" if index in self._turning() else (
                f"pose.shift = path_time * {vector(screw(motion).velocity)}")
            select.append(f"{_where(ids)}{value};")
        return [*function("vec3 to_rest(int id, vec3 p)", [*select, "return (p - pose.shift) * pose.turn;"]),
                *function("vec3 from_rest(int id, vec3 n)", [*select, "return pose.turn * n;"])]


def _where(ids: Sequence[int]) -> str:
    return f"if ({is_any(ids)}) "
