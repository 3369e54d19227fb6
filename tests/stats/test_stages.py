"""Intervals of means whose batches were too few until their own variance said so: how often they miss, simulated."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from harness.stats.bias import mean_error_verdict
from harness.stats.deviates import half_width, skew_interval, staged
from harness.studies.plan import ENOUGH, MAX_REPLICA_FACTOR, STAGES

RUNS, FIRST = 20000, 8
Law = Callable[[np.random.Generator, tuple[int, ...]], np.ndarray]
Moments = tuple[np.ndarray, np.ndarray, np.ndarray]


def normal(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    return rng.standard_normal(shape)


def gamma(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Of shape 2, with mean 0 and variance 1: skewness √2."""
    return (rng.gamma(2.0, size=shape) - 2) / np.sqrt(2)


def lognormal(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Of σ 0.8, with mean 0 and variance 1: skewness 3.7."""
    square = np.exp(0.8**2)
    return (rng.lognormal(0.0, 0.8, shape) - np.sqrt(square)) / np.sqrt(square * (square - 1))


def moments(batches: np.ndarray, counts: np.ndarray) -> Moments:
    """Mean, and the mean's variance and third moment, of the first so many batches of each run, (R,) each."""
    there = np.arange(batches.shape[1]) < counts[:, None]
    mean = np.where(there, batches, 0).sum(1) / counts
    away = np.where(there, batches - mean[:, None], 0)
    return (mean, (away**2).sum(1) / (counts * (counts - 1)),
            (away**3).sum(1) / (counts * (counts - 1.0) * (counts - 2)))


def grown(rng: np.random.Generator, law: Law, ratio: float, stages: int) -> tuple[Moments, np.ndarray]:
    """Runs of `FIRST` batches that grow, as a study's do, where their variance asks for more; and how many each has.

    `ratio`: how many times the first batches are enough where the variance is known.
    """
    most = MAX_REPLICA_FACTOR * FIRST
    batches, counts, going = law(rng, (RUNS, most)), np.full(RUNS, FIRST), np.ones(RUNS, dtype=bool)
    for _ in range(stages):
        needed = np.ceil(counts * moments(batches, counts)[1] * ratio * FIRST)
        going &= (needed > ENOUGH * counts) & (counts < most)
        counts = np.where(going, np.minimum(needed, most), counts).astype(int)
    return moments(batches, counts), counts


@pytest.mark.parametrize(("law", "ratio", "stages", "missed", "before"), [
    (normal, 2.5, 1, 0.053, 0.060), (normal, 2.5, STAGES, 0.053, 0.060), (gamma, 4, STAGES, 0.075, 0.100),
    (lognormal, 8, STAGES, 0.115, 0.170)])
def test_intervals_hold_after_stages(rng: np.random.Generator, law: Law, ratio: float, stages: int, missed: float,
                                     before: float) -> None:
    """At 5 %: of normal batches the level, of skewed ones much nearer to it than Student's interval of all comes."""
    (mean, variance, third), counts = grown(rng, law, ratio, stages)
    dofs = np.array([staged(FIRST - 1, count - 1) if count > FIRST else FIRST - 1 for count in counts])
    low, high = skew_interval(mean, variance, third, dofs, 0.05)
    assert np.mean((low > 0) | (high < 0)) < missed
    student = half_width(np.sqrt(variance), counts - 1.0, 0.05)
    assert np.mean(np.abs(mean) > student) > before, "what is compared with has changed"


def test_degrees_of_freedom_lie_between_those_of_the_first_batches_and_of_all() -> None:
    assert staged(7, 7) == pytest.approx(7)
    assert 7 < staged(7, 63) < 14
    assert staged(63, 127) == pytest.approx(84, abs=1)
    assert staged(0, 15) == 0, "one batch knows no variance"


def test_the_verdicts_interval_knows_of_skewness(rng: np.random.Generator) -> None:
    """A gamma law of shape 1/2, 8 batches a side of which the reference is exact: Student's interval misses in 15 %."""
    batches = 1 + 0.01 * (rng.gamma(0.5, size=(4000, FIRST)) - 0.5) / np.sqrt(0.5)
    mean, variance, third = (each.reshape(-1, 4) for each in moments(batches, np.full(4000, FIRST)))
    missed = {}
    for known in (False, True):
        found = [mean_error_verdict(m, v, FIRST - 1, np.ones(4), np.zeros(4), np.inf, test_third=t if known else None)
                 for m, v, t in zip(mean, variance, third, strict=True)]
        missed[known] = np.mean([(each.low > 0) | (each.high < 0) for each in found])
    assert missed[True] < 0.07 < 0.13 < missed[False]


def test_skewness_of_the_reference_counts_the_other_way() -> None:
    """A test that is too low by too few bright samples, or a reference that is: the interval is long on that side."""
    skewed, none = np.full(4, 3e-9), np.zeros(4)
    sides = [mean_error_verdict(np.ones(4), np.full(4, 1e-6), 7, np.ones(4), np.full(4, 1e-6), 7, test_third=test,
                                reference_third=reference)
             for test, reference in ((skewed, none), (none, skewed), (skewed, skewed))]
    longer = [float(each.high[0] + each.low[0]) for each in sides]
    assert longer[0] > 1e-4 and longer[1] == pytest.approx(-longer[0]) and longer[2] == pytest.approx(0, abs=1e-12)


def test_a_lopsided_interval_is_told_whole() -> None:
    found = mean_error_verdict(np.ones(4), np.full(4, 1e-6), 7, np.ones(4), np.zeros(4), np.inf,
                               test_third=np.full(4, 1e-9))
    assert found.outcome == "inconclusive"
    assert found.reason.startswith("red +0 % [-0.236 %, +0.")
    assert f"{100 * found.high[0]:+.3g} %]" in found.reason
    decided = (found.high[0] / found.tolerance)**2
    assert f"about {decided:.2g} times the samples would decide" in found.reason
