"""Light sampling in drjit: `lib/lights.glsl`, and the choice of a light, written out a second time.

Directions are made of the same numbers by the same formulas, so that they are those of the shader up to rounding.
Their densities are not: those of points drawn on a surface follow from where Mitsuba's ray meets Mitsuba's shape,
distance² over area and cosine, so that an error of the shader's shows in the difference. What the two share, which part
of a cube or of a cylinder faces a vertex and how much of the sky a ball covers, is proved by itself
(`tests/glsl/test_lights.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from harness.reference.draws import rand, rand2, sample_cosine, to_world
from harness.reference.map_draws import MapDraws
from harness.scene import Scene
from harness.scene.lights import ENVIRONMENT, Light, area, face_areas, reach
from harness.scene.model import EnvironmentMap, Shape

# From a vertex to where a shape of this index rests: (point, index of the shape) -> point. And directions back.
Carry = Callable[[Any, int], Any]


class Aimed(NamedTuple):
    """A direction to a light: world space; the light's shape, -1 for the environment; with what chance the light was
    chosen; and the state after the draws."""

    direction: Any
    shape: Any
    chance: Any
    state: Any


@dataclass(frozen=True)
class LightDraws:
    """How vertices choose lights and aim at them; `lights` as the shader has them, in its order. `compensated`: of an
    environment map, only what is above its mean is drawn."""

    mi: Any
    scene: Scene
    lights: tuple[Light, ...]
    compensated: bool = False

    @property
    def has_map(self) -> bool:
        """Whether a number is spent on the cell of an environment map."""
        return isinstance(self.scene.environment, EnvironmentMap) and any(
            light.shape == ENVIRONMENT for light in self.lights)

    def aim(self, o: Any, n: Any, state: Any, to_rest: Carry, from_rest: Carry) -> Aimed:
        """From points `o` with normals `n`, (world space)."""
        mi = self.mi
        import drjit as dr

        shape, chance = mi.Int32(self.lights[0].shape), mi.Float(self.lights[0].chance)
        if len(self.lights) > 1:
            u, state = rand(state)
            start = self.lights[0].chance
            for light in self.lights[1:]:
                later = u >= start
                shape = dr.select(later, light.shape, shape)
                chance = dr.select(later, light.chance, chance)
                start += light.chance
        pick = mi.Float(0)
        if self.has_map:
            pick, state = rand(state)
        a, b, state = rand2(state)
        direction = n
        for light in self.lights:
            if light.shape == ENVIRONMENT:
                found = self._to_sky(n, pick, a, b)
            else:
                at = to_rest(o, light.shape)
                found = from_rest(_towards(mi, self.scene.shapes[light.shape], at, a, b), light.shape)
            direction = dr.select(shape == light.shape, found, direction)
        return Aimed(direction, shape, chance, state)

    def _to_sky(self, n: Any, pick: Any, a: Any, b: Any) -> Any:
        return self._map.direction(pick, a, b) if self.has_map else sample_cosine(n, a, b)

    def sky_density(self, direction: Any, n: Any) -> Any:
        """Per steradian, of directions to the environment, from surfaces with normals `n` where it has no map; without
        the chance of being chosen."""
        import drjit as dr

        return self._map.density(direction) if self.has_map else dr.maximum(dr.dot(n, direction), 0) * dr.inv_pi

    @property
    def _map(self) -> MapDraws:
        assert isinstance(self.scene.environment, EnvironmentMap)
        return MapDraws(self.mi, self.scene.environment, self.compensated)

    def density(self, shape: Any, o: Any, t: Any, facing: Any, to_rest: Carry) -> Any:
        """Per steradian, of directions from `o` to where they meet the lit side of the shape of this index, at the
        distance `t` and with the cosine `facing`; without the chance of the light. 0 for what is no light."""
        mi = self.mi
        import drjit as dr

        pdf = mi.Float(0)
        for light in self.lights:
            if light.shape != ENVIRONMENT:
                own = _density(mi, self.scene.shapes[light.shape], to_rest(o, light.shape), t, facing)
                pdf = dr.select(shape == light.shape, own, pdf)
        return pdf

    def chance(self, shape: Any) -> Any:
        """With which the light of this index is chosen; 0 for what is no light."""
        import drjit as dr

        chance = self.mi.Float(0)
        for light in self.lights:
            chance = dr.select(shape == light.shape, light.chance, chance)
        return chance


def _towards(mi: Any, shape: Shape, o: Any, a: Any, b: Any) -> Any:
    """A unit direction from `o` to a shape at rest."""
    import drjit as dr

    axes = [mi.Vector3f(*map(float, shape.matrix[:3, axis])) for axis in range(3)]
    middle = mi.Point3f(*map(float, shape.matrix[:3, 3]))
    inward = shape.kind in ("sphere", "cube") and shape.flip_normals
    if inward:
        z = 1.0 - 2.0 * a
        sine = dr.sqrt(dr.maximum(0, 1.0 - z * z))
        s, c = dr.sincos(dr.two_pi * b)
        return mi.Vector3f(sine * c, sine * s, z)
    if shape.kind in ("sphere", "displacedsphere"):
        height = a * _cap(mi, shape, o)
        sine = dr.sqrt(height * (2.0 - height))
        s, c = dr.sincos(dr.two_pi * b)
        return to_world(sine * c, sine * s, 1.0 - height, dr.normalize(middle - o))
    if shape.kind == "rectangle":
        at = middle + (2.0 * a - 1.0) * axes[0] + (2.0 * b - 1.0) * axes[1]
    elif shape.kind == "disk":
        p = mi.warp.square_to_uniform_disk_concentric(mi.Point2f(a, b))
        at = middle + p.x * axes[0] + p.y * axes[1]
    elif shape.kind == "cube":
        q = _object(mi, shape, o)
        x, y, z = _faces(mi, shape, q)
        share = a * (x + y + z)
        on_x, on_y = share < x, share < x + y
        within = dr.select(on_x, share / x, dr.select(on_y, (share - x) / y, (share - x - y) / z))
        s, t = 2.0 * within - 1.0, 2.0 * b - 1.0
        side = mi.Vector3f(*(dr.select(at < 0, -1.0, 1.0) for at in q))
        p = dr.select(on_x, mi.Vector3f(side.x, s, t),
                      dr.select(on_y, mi.Vector3f(s, side.y, t), mi.Vector3f(s, t, side.z)))
        at = middle + p.x * axes[0] + p.y * axes[1] + p.z * axes[2]
    else:
        q = _object(mi, shape, o)
        away = dr.sqrt(q.x * q.x + q.y * q.y)
        turn, whole = _arc(shape, away), away > 0
        sine, cosine = dr.sincos((2.0 * a - 1.0) * turn)
        x, y = dr.select(whole, q.x / away, 1.0), dr.select(whole, q.y / away, 0.0)
        at = middle + (cosine * x - sine * y) * axes[0] + (cosine * y + sine * x) * axes[1] + b * axes[2]
    return dr.normalize(at - o)


def _density(mi: Any, shape: Shape, o: Any, t: Any, facing: Any) -> Any:
    import drjit as dr

    if shape.kind in ("sphere", "cube") and shape.flip_normals:
        return mi.Float(0.25 * float(np.reciprocal(np.pi)))
    if shape.kind in ("sphere", "displacedsphere"):
        return 0.5 * dr.inv_pi / _cap(mi, shape, o)
    if shape.kind == "cube":
        x, y, z = _faces(mi, shape, _object(mi, shape, o))
        faced = x + y + z
    elif shape.kind == "cylinder":
        q = _object(mi, shape, o)
        faced = area(shape) * dr.inv_pi * _arc(shape, dr.sqrt(q.x * q.x + q.y * q.y))
    else:
        faced = mi.Float(area(shape))
    return t * t / (faced * facing)


def _cap(mi: Any, shape: Shape, o: Any) -> Any:
    """1 - cos of the half angle at which a ball is seen; 2 from inside."""
    import drjit as dr

    sine2 = reach(shape)**2 / dr.squared_norm(mi.Point3f(*map(float, shape.matrix[:3, 3])) - o)
    return dr.select(sine2 < 1, sine2 / (1 + dr.sqrt(dr.maximum(0, 1 - sine2))), 2.0)


def _object(mi: Any, shape: Shape, o: Any) -> Any:
    rows = np.linalg.inv(shape.matrix)[:3]
    return mi.Vector3f(*(float(x) * o.x + float(y) * o.y + float(z) * o.z + float(w) for x, y, z, w in rows))


def _faces(mi: Any, shape: Shape, q: Any) -> list[Any]:
    """Areas of the faces of a cube across x, y and z that face what is at q in its space."""
    import drjit as dr

    return [dr.select(dr.abs(at) > 1, size, 0.0) for at, size in zip(q, face_areas(shape), strict=True)]


def _arc(shape: Shape, away: Any) -> Any:
    import drjit as dr

    if shape.flip_normals:
        return type(away)(float(np.pi))
    return dr.select(away > 1, dr.acos(dr.minimum(1, 1 / away)), 0.0)
