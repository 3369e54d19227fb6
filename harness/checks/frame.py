"""Whether a frame about an axis is orthonormal, for every axis."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness.checks.finding import Finding

# Largest entry of |FFᵀ - 1| of a frame in float32.
ORTHONORMAL = 1e-5


def frame(make: Callable[[np.ndarray], np.ndarray], directions: np.ndarray | None = None, *,
          tolerance: float = ORTHONORMAL) -> Finding:
    """Judge the frames that `make` has about unit axes (N, 3), by default those of `axes`: (N, 3, 3), rows x, y, z.

    `value` is the number of axes without an orthonormal frame; NaN counts as none.
    """
    about = axes() if directions is None else directions
    found = defects(make(about))
    bad = found > tolerance
    sentence = f"{bad.sum():,} of {len(about):,} axes have no orthonormal frame, within {tolerance:g}"
    if bad.any():
        worst = ", ".join(f"{value:.4g}" for value in about[found.argmax()])
        sentence += f"; worst about ({worst}), by {found.max():.2g}"
    return Finding("frame", float(bad.sum()), 0.0, not bad.any(), sentence, error=0.0)


def defects(frames: np.ndarray) -> np.ndarray:
    """How far frames (N, 3, 3) are from orthonormal: largest |FFᵀ - 1|, infinite for NaN; (N,)."""
    gram = np.einsum("nij,nkj->nik", frames, frames)
    return np.nan_to_num(np.abs(gram - np.eye(3)).max(axis=(1, 2)), nan=np.inf)


def axes(count: int = 10_000) -> np.ndarray:
    """Axes (N, 3) about which a frame must exist: so many at random, and the 26 along edges and diagonals of the cube.

    Exact in float32.
    """
    corners = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    found = np.concatenate([np.random.default_rng(1).normal(size=(count, 3)), corners[np.any(corners != 0, axis=1)]])
    unit = found / np.linalg.norm(found, axis=1, keepdims=True)
    return unit.astype(np.float32).astype(np.float64)
