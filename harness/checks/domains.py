"""Where samples lie: maps of the unit square to the sphere of directions, whose cells and midpoints are those of grids.

A domain says by `jacobian` how much solid angle a unit of the square takes, so that the mean of f · jacobian over the
square is the integral of f over the domain.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

Axis = tuple[float, float, float]
UP: Axis = (0.0, 0.0, 1.0)


class Domain(Protocol):
    """Points of the unit square (N, 2) to directions (N, 3), and back."""

    def forward(self, p: np.ndarray) -> np.ndarray:
        """Directions (N, 3) of points (N, 2)."""

    def backward(self, d: np.ndarray) -> np.ndarray:
        """Points (N, 2) of directions (N, 3); outside [0, 1]² where a direction is outside the domain."""

    def jacobian(self, p: np.ndarray) -> np.ndarray:
        """Steradians per unit of the square at points, (N,)."""


@dataclass(frozen=True)
class Sphere:
    """The sphere about an axis by (azimuth, height), both even: all cells have the same solid angle."""

    axis: Axis = UP

    def forward(self, p: np.ndarray) -> np.ndarray:
        """Height runs from 1, on the axis, to -1."""
        return _direction(self.axis, p[:, 0], 2 * p[:, 1])

    def backward(self, d: np.ndarray) -> np.ndarray:
        """Of any unit directions."""
        azimuth, drop = _azimuth_and_drop(self.axis, d)
        return np.stack([azimuth, drop / 2], axis=-1)

    def jacobian(self, p: np.ndarray) -> np.ndarray:
        """4π everywhere."""
        return np.full(len(p), 4 * np.pi)


@dataclass(frozen=True)
class Crowded:
    """The sphere about an axis by (azimuth, t), 1 - cos θ = 2 t⁴: cells shrink towards the axis, where lobes are.

    Of even rows, a lobe of exponent 1000 would fill a single one.
    """

    axis: Axis

    def forward(self, p: np.ndarray) -> np.ndarray:
        """t runs from 0, on the axis, to 1, opposite."""
        return _direction(self.axis, p[:, 0], 2 * p[:, 1]**4)

    def backward(self, d: np.ndarray) -> np.ndarray:
        """Of any unit directions."""
        azimuth, drop = _azimuth_and_drop(self.axis, d)
        return np.stack([azimuth, (drop / 2)**0.25], axis=-1)

    def jacobian(self, p: np.ndarray) -> np.ndarray:
        """2π d(1 - cos θ)/dt."""
        return np.asarray(16 * np.pi * p[:, 1]**3)


@dataclass(frozen=True)
class Lobe:
    """The hemisphere about an axis by (azimuth, cos^(exponent + 1) θ), over which (α+1)/(2π) cos^α is spread evenly.

    Made for quadrature: of a product with that lobe every midpoint counts alike. Exponent 0 is the even hemisphere.
    """

    axis: Axis = UP
    exponent: float = 0.0

    def forward(self, p: np.ndarray) -> np.ndarray:
        """From the horizon to the axis."""
        return _direction(self.axis, p[:, 0], 1 - p[:, 1]**(1 / (self.exponent + 1)))

    def backward(self, d: np.ndarray) -> np.ndarray:
        """Negative where a direction is below the horizon."""
        azimuth, drop = _azimuth_and_drop(self.axis, d)
        return np.stack([azimuth, np.where(drop <= 1, np.maximum(1 - drop, 0)**(self.exponent + 1), -1)], axis=-1)

    def jacobian(self, p: np.ndarray) -> np.ndarray:
        """2π d(cos θ)/dv; finite at midpoints, which are never on the horizon."""
        return np.asarray(2 * np.pi / (self.exponent + 1) * p[:, 1]**(1 / (self.exponent + 1) - 1))


def midpoints(rows: int, columns: int) -> np.ndarray:
    """Of the unit square's cells, (rows * columns, 2), row by row along its second coordinate."""
    second, first = np.meshgrid((np.arange(rows) + 0.5) / rows, (np.arange(columns) + 0.5) / columns, indexing="ij")
    return np.stack([first.ravel(), second.ravel()], axis=-1)


def _frame(axis: Axis) -> np.ndarray:
    """Rows x, y, z of a right-handed frame whose z is the axis, (3, 3) float64."""
    z = np.array(axis) / np.linalg.norm(axis)
    x = np.cross(np.eye(3)[np.abs(z).argmin()], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def _direction(axis: Axis, azimuth: np.ndarray, drop: np.ndarray) -> np.ndarray:
    """Directions (N, 3) at an azimuth, in turns, whose cosine to the axis is 1 - drop; exact where drop is small."""
    turn, sine = 2 * np.pi * azimuth, np.sqrt(np.maximum(drop * (2 - drop), 0))
    return np.asarray(np.stack([np.cos(turn) * sine, np.sin(turn) * sine, 1 - drop], axis=-1) @ _frame(axis))


def _azimuth_and_drop(axis: Axis, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The inverse of `_direction`: azimuth in turns within [0, 1), and 1 - cosine, both (N,)."""
    x, y, z = (d @ _frame(axis).T).T
    drop = np.where(z > 0, (x * x + y * y) / (1 + np.maximum(z, 0)), 1 - z)
    return np.arctan2(y, x) / (2 * np.pi) % 1, np.clip(drop, 0, 2)
