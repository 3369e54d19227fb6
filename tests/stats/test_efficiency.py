"""Variances of one sample, and factors between them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from harness.errors import HarnessError
from harness.stats.efficiency import Factor, sample_variance

SPP = np.array([1, 4, 16])


def test_variance_is_samples_times_squared_error_of_whole_runs() -> None:
    """Whatever the shorter prefixes did."""
    rmse = np.array([[9.0, 9.0, 0.5], [1.0, 7.0, 0.5]])
    found = sample_variance(SPP, rmse)
    assert (found.value, found.low, found.high) == pytest.approx((4.0, 4.0, 4.0))


def test_interval_is_the_jackknifes_of_the_logarithm() -> None:
    errors = np.array([0.5, 0.6, 0.4, 0.55])
    squares = 16 * errors**2
    whole = math.log(squares.mean())
    pseudo = [4 * whole - 3 * math.log(np.delete(squares, k).mean()) for k in range(4)]
    low, high = stats.t.interval(0.9, 3, np.mean(pseudo), stats.sem(pseudo))
    found = sample_variance(SPP, errors[:, None] * np.ones(3), 0.9)
    assert (found.low, found.high) == pytest.approx((math.exp(low), math.exp(high)))


def test_interval_of_a_ratio_covers_the_truth(rng: np.random.Generator) -> None:
    """Mean squared errors of 8 replicas over 200 pixels; a true ratio of 4; 95 % of 500, within four errors."""
    covered = 0
    for _ in range(500):
        ours, theirs = (np.sqrt(scale * rng.chisquare(200, (8, 1)) / 200 / 16) for scale in (4.0, 1.0))
        found = sample_variance(np.array([16]), ours).over(sample_variance(np.array([16]), theirs))
        covered += found.low < 4.0 < found.high
    assert abs(covered / 500 - 0.95) < 4 * math.sqrt(0.95 * 0.05 / 500)


def test_single_replica_has_a_value_and_no_interval() -> None:
    assert sample_variance(SPP, np.array([0.5, 0.5, 0.5])) == Factor(4.0, 0.0, math.inf)


@pytest.mark.parametrize("last", [0.0, math.nan])
def test_error_that_vanished_has_no_variance(last: float) -> None:
    assert math.isnan(sample_variance(SPP, np.array([[1.0, 1.0, 0.1], [1.0, 1.0, last]])).value)


def test_shapes_must_match() -> None:
    with pytest.raises(HarnessError, match=r"\(replicas, 3\)"):
        sample_variance(SPP, np.ones((2, 4)))


def test_an_unbounded_interval_stays_unbounded() -> None:
    """A single replica says nothing about its own spread."""
    ratio = Factor(8.0, 0.0, np.inf).over(Factor(2.0, 1.9, 2.1))
    assert (ratio.value, ratio.low, ratio.high) == (pytest.approx(4.0), 0.0, np.inf)


def test_known_factors_divide_in_quadrature() -> None:
    """exp(±0.3) over exp(±0.4) is exp(±0.5)."""
    ratio = Factor(6.0, 6 * np.exp(-0.3), 6 * np.exp(0.3)).over(Factor(2.0, 2 * np.exp(-0.4), 2 * np.exp(0.4)))
    assert (ratio.value, ratio.low, ratio.high) == pytest.approx((3.0, 3 * np.exp(-0.5), 3 * np.exp(0.5)))
