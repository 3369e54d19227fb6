"""The test of a sampler that is the library's own: where it sends light, against Mitsuba's own sampling."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy import special

from harness.diagnosis.case import Case
from harness.diagnosis.record import ScatterRecord
from harness.gpu.tap import Observed

# Sixteen cells of directions: by the cosine to the mirror direction, so that lobes have cells of their own; steep or
# grazing, which halves those drawn by the cosine; and the side of the plane of incidence.
RINGS, STEEP, SIDES = (0.9, 0.5, 0.0), 0.5**0.5, 2
CELLS = (len(RINGS) + 1) * 2 * SIDES
# The probability with which a right sampler fails, over all cells and the whole.
LEVEL = 1e-3
# Mitsuba draws so many directions at each vertex.
DRAWS = 4


class Scatter:
    """Sums over vertices of weight x [direction in cell], of the library's sampler less Mitsuba's."""

    def __init__(self) -> None:
        self._sum = np.zeros(CELLS + 1)
        self._squares = np.zeros(CELLS + 1)
        self._whole = 0.0
        self._vertices = 0
        self._rng = np.random.default_rng(4)

    def add(self, case: Case, seen: Observed, number: int) -> None:
        """The vertices number `number` of a look at which paths scatter."""
        records = seen.vertices[number]
        scatters = (seen.paths["gaze"][:, 3] > number) & ((records["normal"][:, 3].astype(int) & 16) != 0)
        where = np.flatnonzero(scatters & np.isfinite(records["weight"][:, :3]).all(axis=1))
        if not len(where):
            return
        origin, ray = records["origin"][where, :3], records["ray"][where, :3]
        normal = records["facing"][where, :3].astype(np.float64)
        mine = _cells(normal, ray, records["direction"][where, :3], records["weight"][where, :3])
        theirs = np.zeros_like(mine)
        for _ in range(DRAWS):
            drawn, weight = case.steps.scatter(origin, ray, self._rng.random((len(where), 3)))
            theirs += _cells(normal, ray, drawn, np.nan_to_num(weight)) / DRAWS
        difference = mine - theirs
        self._sum += difference.sum(axis=0)
        self._squares += (difference**2).sum(axis=0)
        self._whole += float(theirs[:, -1].sum())
        self._vertices += len(where)

    def record(self) -> ScatterRecord | None:
        """The verdict; None where nothing scattered."""
        if self._vertices < 2 or self._whole <= 0:
            return None
        error = np.sqrt(np.maximum(self._squares - self._sum**2 / self._vertices, 0))
        known = error > 0
        z = np.abs(self._sum[known]) / error[known]
        largest = float(z.max(initial=0.0))
        # Normal tails, shared by all cells; each cell is a mean over thousands of vertices.
        limit = math.sqrt(2) * float(special.erfcinv(LEVEL / max(int(known.sum()), 1)))
        return ScatterRecord(self._vertices, largest, float(self._sum[-1] / self._whole),
                             float(error[-1] / self._whole), largest > limit)


def _cells(normal: np.ndarray, ray: np.ndarray, direction: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Mean of the weight's channels in the direction's cell, (N, cells + 1); the last column is the whole."""
    ray, direction = ray.astype(np.float64), direction.astype(np.float64)
    mirror = ray - 2 * (normal * ray).sum(axis=1, keepdims=True) * normal
    ring = sum(((mirror * direction).sum(axis=1) < bound).astype(int) for bound in RINGS)
    steep = (normal * direction).sum(axis=1) > STEEP
    side = (np.cross(normal, ray) * direction).sum(axis=1) > 0
    value: Any = weight.astype(np.float64).mean(axis=1)
    found = np.zeros((len(value), CELLS + 1))
    found[np.arange(len(value)), (ring * 2 + steep) * SIDES + side] = value
    found[:, -1] = value
    return found
