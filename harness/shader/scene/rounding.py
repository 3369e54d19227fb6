"""Transforms without what rounding has left in them, so that literals are what was meant, on every processor.

A rotation by a right angle has entries of 6e-17 for zeros, and where a matrix is inverted it depends on the processor,
whose linear algebra it is, whether there stands 1e-17 or 0. As zeros they cost nothing: 2 % of spheres, and where
denormals are not flushed, since noise is cubed near its lattice, 40 % of procedural textures. float32 knows 6e-8 of the
others.
"""

from __future__ import annotations

import numpy as np

from harness.scene.model import Shape

ROUNDING = 1e-9  # of an axis: what is smaller is rounding


def zeroed(matrix: np.ndarray) -> np.ndarray:
    """An affine (4, 4) matrix: each axis by its own largest entry, the place by that of the longest axis."""
    sizes = np.abs(matrix[:3, :3]).max(axis=0)
    return _without(matrix, ROUNDING * np.append(sizes, sizes.max()))


def to_object(shape: Shape) -> np.ndarray:
    """The inverse of a shape's `to_world`, (4, 4): each coordinate by the largest of what it takes of x, y and z, its
    addend by the shape's own extent, which is 1."""
    inverse = np.linalg.inv(shape.matrix)
    sizes = np.abs(inverse[:3, :3]).max(axis=1)
    return _without(inverse, ROUNDING * np.column_stack([sizes, sizes, sizes, np.ones(3)]))


def _without(matrix: np.ndarray, limits: np.ndarray) -> np.ndarray:
    kept = matrix.copy()
    kept[:3][np.abs(kept[:3]) < limits] = 0.0
    return kept
