"""The test of a sampler that is the library's own: where it sends paths, or the light that they carry."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
from scipy import special

from harness.diagnosis import expected
from harness.diagnosis.case import Case
from harness.diagnosis.record import ScatterRecord
from harness.diagnosis.seen import Seen
from harness.gpu.tap import Records
from harness.stats.deviates import skew_deviate

# Sixteen cells of directions: by the cosine to the mirror direction, so that lobes have cells of their own; steep or
# grazing, which halves those drawn by the cosine; and the side of the plane of incidence.
RINGS, STEEP, SIDES = (0.9, 0.5, 0.0), 0.5**0.5, 2
CELLS = (len(RINGS) + 1) * 2 * SIDES
# The probability with which a right sampler fails, over all cells and the whole: hundreds are tested for one score.
LEVEL = 1e-5
# So many directions are drawn at each vertex to compare with.
DRAWS = 4
# Weights below it are none: a power underflows in float32 that does not in float64.
NO_WEIGHT = 1e-6
SAMPLERS = {1: "sample_uniform", 2: "sample_cosine", 3: "sample_lobe"}


class Distribution:
    """Sums over vertices, of the library's sampler less what it is compared with.

    Where its weights are the strategy's (the case has no density of its own), of [direction in cell], against
    directions drawn by the strategy from its definition: bounded numbers, whose sums are normal. Else of weight x
    [direction in cell], against Mitsuba's own sampling, whose tails may be heavy.
    """

    def __init__(self) -> None:
        self._moments = np.zeros((3, CELLS + 1))  # sums of the first, second and third powers
        self._whole = 0.0
        self._vertices = 0
        self._rng = np.random.default_rng(4)
        self.samplers: Counter[str] = Counter()

    def add(self, case: Case, seen: Seen, number: int) -> None:
        """The vertices number `number` of a look at which paths scatter."""
        records = seen.vertex(number)
        scatters = (seen.paths["gaze"][:, 3] > number) & ((records["normal"][:, 3].astype(int) & 16) != 0)
        scatters &= (records["diffuse"][:, :3] + records["glossy"][:, :3]).max(axis=1) > 0
        where = np.flatnonzero(scatters & np.isfinite(records["weight"][:, :3]).all(axis=1))
        if not len(where):
            return
        records = {name: values[where] for name, values in records.items()}
        normal, ray = records["facing"][:, :3].astype(np.float64), records["ray"][:, :3]
        draw = _by_mitsuba if "density" in case.own else _by_definition
        worth = records["weight"][:, :3].astype(np.float64).mean(axis=1)
        counts = "density" not in case.own
        mine = _cells(normal, ray, records["direction"][:, :3], (worth > NO_WEIGHT).astype(float) if counts else worth)
        theirs = np.zeros_like(mine)
        for _ in range(DRAWS):
            drawn, weight = draw(case, records, self._rng.random((len(where), 3)))
            value = np.nan_to_num(weight).mean(axis=1)
            theirs += _cells(normal, ray, drawn, (value > NO_WEIGHT).astype(float) if counts else value) / DRAWS
        difference = mine - theirs
        self._moments += np.stack([(difference**power).sum(axis=0) for power in (1, 2, 3)])
        self._whole += float(theirs[:, -1].sum())
        self._vertices += len(where)
        self.samplers.update(SAMPLERS[which] for which in records["tangent"][:, 3].astype(int) if which in SAMPLERS)

    def record(self) -> ScatterRecord | None:
        """The verdict; None where nothing scattered."""
        n = self._vertices
        if n < 2 or self._whole <= 0:
            return None
        first, second, third = self._moments / n
        variance = np.maximum(second - first**2, 0)
        cubes = third - 3 * first * second + 2 * first**3
        known = variance > 0
        # Of a mean of n: a variance by n, a third moment by n squared.
        dof = np.full(int(known.sum()), n - 1)
        z = np.abs(skew_deviate(first[known], variance[known] / n, cubes[known] / n**2, dof))
        largest = float(np.nanmax(z, initial=0.0))
        # Shared by all cells.
        limit = math.sqrt(2) * float(special.erfcinv(LEVEL / max(int(known.sum()), 1)))
        return ScatterRecord(n, largest, float(n * first[-1] / self._whole),
                             float(math.sqrt(n * variance[-1]) / self._whole), largest > limit)


def _by_mitsuba(case: Case, records: Records, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return case.steps.scatter(records["origin"][:, :3], records["ray"][:, :3], numbers)


def _by_definition(case: Case, records: Records, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    normal, ray, diffuse, glossy = (records[name].astype(np.float64) for name in ("facing", "ray", "diffuse", "glossy"))
    normal, kd, alpha, ks, share = normal[:, :3], diffuse[:, :3], diffuse[:, 3], glossy[:, :3], glossy[:, 3]
    mirror = expected.mirrored(normal, -ray[:, :3])
    drawn, by_lobe = expected.scattered(case.drawn, normal, mirror, share, alpha, numbers)
    cosine = (normal * drawn).sum(axis=1)
    lobe = expected.lobe_pdf((mirror * drawn).sum(axis=1), alpha)
    value = expected.brdf(kd, ks, lobe) * np.maximum(cosine, 0)[:, None]
    return drawn, expected.weight(case.drawn, value, kd, ks, share, cosine, lobe, by_lobe)


def _cells(normal: np.ndarray, ray: np.ndarray, direction: np.ndarray, value: np.ndarray) -> np.ndarray:
    """The value (N,) in the direction's cell, (N, cells + 1); the last column is the whole."""
    ray, direction = ray.astype(np.float64), direction.astype(np.float64)
    mirror = ray - 2 * (normal * ray).sum(axis=1, keepdims=True) * normal
    ring = sum(((mirror * direction).sum(axis=1) < bound).astype(int) for bound in RINGS)
    steep = (normal * direction).sum(axis=1) > STEEP
    side = (np.cross(normal, ray) * direction).sum(axis=1) > 0
    found = np.zeros((len(value), CELLS + 1))
    found[np.arange(len(value)), (ring * 2 + steep) * SIDES + side] = value
    found[:, -1] = value
    return found
