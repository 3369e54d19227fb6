"""The generator of lib/random.glsl: numbers in [0, 1), even, many, and never those of another sample again.

Nothing here asks that samples or pixels be unrelated: those of a low-discrepancy sequence are not, and are right.
Replicas must be: they are what errors are told from.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from scipy import special

from harness.checks.chi2 import pearson
from harness.checks.finding import LEVEL, Finding, shared_level
from harness.checks.random import distinct
from harness.checks.shader import Probe

COUNT = 1 << 16  # of samples, of pixels, of replicas
NUMBERS = 8
CELLS = 256  # of a single number; of a pair, 16 each way
# Samples that may draw another's numbers: of seeds of 24 random bits 128 of so many do, of 32 bits one or none; of a
# seed that leaves something out, most.
BY_CHANCE = 256


def findings(probe: Probe) -> Iterator[Finding]:
    """Of the first eight numbers of many samples of a pixel, of many pixels, and of many replicas."""
    populations = {name: _drawn(probe, name) for name in ("samples of a pixel", "pixels", "replicas")}
    for name, numbers in populations.items():
        yield _within(name, numbers)
    repeats = {name: _repeats(name, numbers) for name, numbers in populations.items()}
    yield from repeats.values()
    yield _many(populations)
    for name in ("samples of a pixel", "replicas"):
        if repeats[name].passed:  # else they are uneven by that alone
            yield _even(name, populations[name])
            yield _pairs(name, populations[name])


def _drawn(probe: Probe, population: str) -> np.ndarray:
    """(COUNT, 8) float64, a row for each of the population."""
    many, none = np.arange(COUNT), np.zeros(COUNT, dtype=int)
    x, y, replica, sample = {"samples of a pixel": (none + 37, none + 11, none, many),
                             "pixels": (many % 256, many // 256, none, none + 5),
                             "replicas": (none + 37, none + 11, many, none)}[population]
    found = probe("random.frag", np.stack([x, y, replica, none], axis=-1),
                  np.stack([sample >> 16, sample & 0xFFFF, none, none], axis=-1), outputs=3)
    return np.asarray(found[:, :NUMBERS], dtype=np.float64)


def _within(name: str, numbers: np.ndarray) -> Finding:
    bad = ~((numbers >= 0) & (numbers < 1))
    worst = numbers[bad][0] if bad.any() else 0.0
    return Finding("range", float(bad.sum()), 0.0, not bad.any(), f"{bad.sum():,} of {numbers.size:,} numbers of many "
                   f"{name} are outside [0, 1)" + (f", such as {worst:g}" if bad.any() else ""), error=0.0,
                   function="rand")


def _repeats(name: str, numbers: np.ndarray) -> Finding:
    """Rows of eight numbers that are there twice; equal rows have equal sums, others by chance never."""
    repeated = len(numbers) - len(np.unique(_safe(numbers) @ np.sqrt([2, 3, 5, 7, 11, 13, 17, 19])))
    function = "seed_sample" if name == "samples of a pixel" else "pixel_stream"
    return Finding("repeats", float(repeated), 0.0, repeated <= BY_CHANCE, f"{repeated:,} of {COUNT:,} {name} draw the "
                   f"very numbers of another, expected {BY_CHANCE} at most", error=float(BY_CHANCE), function=function)


def _many(populations: dict[str, np.ndarray]) -> Finding:
    """As many values as chance has: judged where there are most of them, since a sequence has a step of its own."""
    found = [distinct(numbers) for numbers in populations.values()]
    best = max(found, key=lambda each: each.value)
    return Finding("distinct", best.value, 1.0, best.passed, best.sentence, error=best.error, function="rand")


def _even(name: str, numbers: np.ndarray) -> Finding:
    """χ² of each number in CELLS cells."""
    cells = np.clip(_safe(numbers) * CELLS, 0, CELLS - 1).astype(int)
    return _worst("uniform", name, [(f"number {index + 1}", np.bincount(column, minlength=CELLS))
                                    for index, column in enumerate(cells.T)])


def _pairs(name: str, numbers: np.ndarray) -> Finding:
    """χ² of each two numbers of a sample in a square of cells."""
    cells = np.clip(_safe(numbers) * 16, 0, 15).astype(int)
    return _worst("pairs", name, [(f"numbers {a + 1} and {b + 1}", np.bincount(cells[:, a] * 16 + cells[:, b],
                  minlength=256)) for a, b in combinations(range(NUMBERS), 2)])


def _safe(numbers: np.ndarray) -> np.ndarray:
    return np.nan_to_num(numbers, nan=0.0, posinf=1.0, neginf=0.0)


def _worst(check: str, name: str, counted: list[tuple[str, np.ndarray]]) -> Finding:
    """The table of counts that is least even."""
    ps = []
    for _, counts in counted:
        expected = np.full(len(counts), counts.sum() / len(counts))
        statistic, dof = pearson(counts.astype(float), expected)
        ps.append((float(special.chdtrc(dof, statistic)), statistic / dof))
    index = int(np.argmin([p for p, _ in ps]))
    p, value = ps[index]
    return Finding(check, value, 1.0, p > shared_level(LEVEL, len(ps)), f"{counted[index][0]} of a sample, over many "
                   f"{name}, fill their cells with a χ² of {value:.3g} per degree of freedom, p = {p:.2g}", p=p,
                   function="rand")
