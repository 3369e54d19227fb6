"""Directions drawn from an environment map, in drjit: `sample_environment_texel` of `lib/environment.glsl` once more.

The direction is made of the same numbers by the same formulas; its density is the map's own, looked up where the
direction points (`harness.scene.importance`), so that one that does not belong to the draw shows in the difference.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.scene.importance import alias_table, texel_density
from harness.scene.model import EnvironmentMap


@dataclass(frozen=True)
class MapDraws:
    """Draws from one map, in the scene's space."""

    mi: Any
    environment: EnvironmentMap

    def direction(self, pick: Any, a: Any, b: Any) -> Any:
        """A unit direction of numbers in [0, 1): mi.Vector3f."""
        mi = self.mi
        import drjit as dr

        table = alias_table(self.environment)
        rows, columns = table.shape[:2]
        x, y = a * columns, pick * rows
        column, row = (dr.minimum(dr.floor(at), size - 1) for at, size in ((x, columns), (y, rows)))
        rest_x, rest_y = x - column, y - row
        entry = mi.UInt32(row * columns + column)
        share, other_column, other_row = (
            dr.gather(mi.Float, mi.Float(np.ascontiguousarray(table[..., part]).ravel()), entry) for part in range(3))
        own = rest_y < share
        column, row = dr.select(own, column, other_column), dr.select(own, row, other_row)

        side = 2.0 * rest_x - 1.0
        away = 1.0 - dr.sqrt(1.0 - dr.abs(side))
        phi = dr.two_pi * ((column + 0.5 + dr.select(side < 0, -away, away)) / columns)
        zone = dr.floor(b * 4096.0)
        place = b * 4096.0 - zone + 0.5 / 4096.0
        from_pole = dr.minimum(row, rows - 1.0 - row)
        drop = _tent(mi, from_pole, rows, (zone + 0.5) / 4096.0, place)
        height, radius = 1.0 - 2.0 * drop, 2.0 * dr.sqrt(drop * (1.0 - drop))
        s, c = dr.sincos(phi)
        return self._matrix() @ mi.Vector3f(s * radius, dr.select(row == from_pole, height, -height), -c * radius)

    def density(self, direction: Any) -> Any:
        """Per steradian, at unit directions: mi.Float."""
        mi = self.mi
        import drjit as dr

        texels = texel_density(self.environment)
        rows, columns = texels.shape
        values = mi.Float(texels.astype(np.float32).ravel())
        local = self._matrix().T @ direction
        x = dr.atan2(local.x, -local.z) * dr.inv_two_pi * columns - 0.5
        y = dr.atan2(dr.sqrt(local.x * local.x + local.z * local.z), local.y) * dr.inv_pi * (rows - 1)
        column, row = dr.floor(x), dr.minimum(dr.floor(y), rows - 2)
        right, down = x - column, y - row
        near = dr.select(column < 0, column + columns, column)
        far = dr.select(near + 1 >= columns, 0, near + 1)

        def at(row: Any, column: Any) -> Any:
            return dr.gather(mi.Float, values, mi.UInt32(row * columns + column))

        upper = dr.lerp(at(row, near), at(row, far), right)
        return dr.lerp(upper, dr.lerp(at(row + 1, near), at(row + 1, far), right), down)

    def _matrix(self) -> Any:
        return self.mi.Matrix3f(np.array(self.environment.to_world)[:3, :3].tolist())


def _tent(mi: Any, row: Any, rows: int, zone: Any, place: Any) -> Any:
    """The squared sine of half the polar angle of a direction under the tent of a row, counted from the nearer pole."""
    import drjit as dr

    angle = np.pi / (rows - 1)
    half_sine = float(np.sin(0.5 * angle))
    sine, cosine = dr.sincos(0.5 * angle * row)
    on_pole = row < 0.5
    k = dr.select(on_pole, _cap(zone, angle, half_sine), half_sine * dr.sqrt(zone))
    c = dr.sqrt(1.0 - k * k)
    nearest = sine * c - cosine * k
    return dr.select(on_pole, place * k * k, nearest * nearest + place * 4.0 * cosine * sine * k * c)


def _cap(part: Any, cap: float, half_sine: float) -> Any:
    import drjit as dr

    c = dr.power(part, 1.0 / 3.0)
    y, x = c * c, cap * cap
    bent = x * (0.02500142 + x * (0.000636777 + 0.000844828 * y
                                  + x * (1.893667e-5 + y * (9.31922e-6 + y * 4.92828e-5))))
    return half_sine * c * (1.0 + (1.0 - y) * bent)
