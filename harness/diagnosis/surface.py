"""The surface of a displaced sphere itself, for which Mitsuba has a mesh: how far a point is off it, and its normal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.scene import Shape
from harness.scene.displaced import bounds, normal, radius

# In radii: rays stop within 2e-6 of the surface, or 1.5e-5 where they crept along it (MARCH_TOLERANCE of
# glsl/lib/displaced.glsl and its growth); relative to the tolerance of `distance`.
HEIGHT_SLACK = 5.0
# Of normals, relative to the tolerance of `normal`: gradients of noise in float32.
NORMAL_SLACK = 40.0


@dataclass(frozen=True, eq=False)
class Residual:
    """`height` (N,) above the surface, radii; `normal` (N, 3): what the shader's is off by; how much of the tolerances
    of `distance` and `normal` is rounding here."""

    height: np.ndarray
    normal: np.ndarray
    slack: float = HEIGHT_SLACK
    normal_slack: float = NORMAL_SLACK


def shell(shape: Shape, points: np.ndarray) -> np.ndarray:
    """How far points (N, 3) are from the centre of a displaced sphere at rest, (N,), as a part of the farthest that its
    surface is."""
    assert shape.displacement is not None
    inverse = np.linalg.inv(shape.matrix)
    return np.linalg.norm(points @ inverse[:3, :3].T + inverse[:3, 3], axis=1) / bounds(shape.displacement).highest


def residual(shape: Shape, place: np.ndarray, found: np.ndarray) -> Residual:
    """Of points (N, 3) of world space on a displaced sphere at rest, and the shader's normals there."""
    assert shape.displacement is not None
    inverse = np.linalg.inv(shape.matrix)
    q = place @ inverse[:3, :3].T + inverse[:3, 3]
    rho = np.linalg.norm(q, axis=1)
    direction = q / rho[:, None]
    r, gradient = radius(shape.displacement, direction)
    outward = normal(direction, r, gradient) @ inverse[:3, :3]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    return Residual(rho - r, found - (-outward if shape.flip_normals else outward))
