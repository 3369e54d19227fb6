"""Directions drawn from an environment map, in drjit: `sample_environment_texel` of `lib/environment.glsl` once more.

The direction is made of the same numbers by the same formulas; its density is the map's own, looked up where the
direction points (`harness.scene.importance`), so that one that does not belong to the draw shows in the difference.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.scene.importance import BINS, sampling_table, texel_density
from harness.scene.model import EnvironmentMap


@dataclass(frozen=True)
class MapDraws:
    """Draws from one map, in the scene's space."""

    mi: Any
    environment: EnvironmentMap
    compensated: bool = False

    def direction(self, pick: Any, a: Any, b: Any) -> Any:
        """A unit direction of numbers in [0, 1): mi.Vector3f."""
        mi = self.mi
        import drjit as dr

        table = sampling_table(self.environment, compensated=self.compensated)
        rows, columns = texel_density(self.environment, compensated=self.compensated).shape
        entries = [mi.Float(np.ascontiguousarray(table[..., part]).ravel()) for part in range(4)]

        def read(row: Any, column: Any) -> list[Any]:
            at = mi.UInt32(row) * table.shape[1] + mi.UInt32(column)
            return [dr.gather(mi.Float, values, at) for values in entries]

        first, count, top, height = read(mi.Float(rows), dr.floor(b * BINS))
        band = dr.floor(first / BINS)
        row, rest_y = _in_run(b, first - BINS * band, count, top, height)
        column, rest_x = _in_run(a, *read(rows + 1 + band, dr.floor(a * BINS)))
        share, other_column, other_row, _ = read(row, column)
        own = pick < share
        place = dr.select(own, pick / share, (pick - share) / (1.0 - share))
        column, row = dr.select(own, column, other_column), dr.select(own, row, other_row)

        side = 2.0 * rest_x - 1.0
        away = 1.0 - dr.sqrt(1.0 - dr.abs(side))
        phi = dr.two_pi * ((column + 0.5 + dr.select(side < 0, -away, away)) / columns)
        from_pole = dr.minimum(row, rows - 1.0 - row)
        drop = _tent(mi, from_pole, rows, rest_y, place)
        height, radius = 1.0 - 2.0 * drop, 2.0 * dr.sqrt(drop * (1.0 - drop))
        s, c = dr.sincos(phi)
        return self._matrix() @ mi.Vector3f(s * radius, dr.select(row == from_pole, height, -height), -c * radius)

    def density(self, direction: Any) -> Any:
        """Per steradian, at unit directions: mi.Float."""
        mi = self.mi
        import drjit as dr

        texels = texel_density(self.environment, compensated=self.compensated)
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


def _in_run(u: Any, first: Any, count: Any, start: Any, size: Any) -> tuple[Any, Any]:
    """The row or column of a run that a number means, and what is left of the number."""
    import drjit as dr

    at = (u * BINS - first) / count * size
    index = dr.minimum(dr.floor(at), size - 1.0)
    return start + index, at - index


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
