"""Deviates of skewed means: Hall's formula, its inverse, and the milder of two answers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from harness.stats.deviates import Z_LIMIT, critical_deviate, one_sided, skew_deviate, skew_interval


def deviate(difference: float, variance: float, third: float, dof: float) -> float:
    return float(skew_deviate(*(np.array(value) for value in (difference, variance, third, dof))))


def test_without_skewness_it_is_students_t_as_a_normal_deviate() -> None:
    assert deviate(2.0, 1.0, 0.0, 9) == pytest.approx(stats.norm.isf(stats.t.sf(2.0, 9)))
    assert deviate(-3.0, 4.0, 0.0, math.inf) == pytest.approx(-1.5)


@pytest.mark.parametrize("t", [-3.0, 3.0])
def test_of_student_and_hall_the_one_nearer_to_zero_counts(t: float) -> None:
    """Right-skewed batches: Hall moves both tails up, t + g t²/3 + g² t³/27 + g/6, which is milder on the left only."""
    g = 0.6
    hall = t + g * t**2 / 3 + g**2 * t**3 / 27 + g / 6
    assert deviate(2 * t, 4.0, g * 8, math.inf) == pytest.approx(hall if t < 0 else t)
    assert abs(hall) > abs(t) if t > 0 else abs(hall) < abs(t)


def test_it_is_odd() -> None:
    """Swapping test and reference turns the sign and nothing else."""
    assert deviate(1.3, 0.5, 0.2, 12) == -deviate(-1.3, 0.5, -0.2, 12)


def test_it_saturates_instead_of_overflowing() -> None:
    """An exact image that is wrong is infinitely many standard errors off; the picture of it stays finite."""
    assert deviate(0.1, 0.0, 0.0, math.inf) == Z_LIMIT
    assert deviate(-1e200, 1e-200, 1e-290, 3) >= -Z_LIMIT
    assert deviate(0.0, 0.0, 0.0, math.inf) == 0.0
    assert math.isnan(deviate(1.0, math.nan, 0.0, 0))


@pytest.mark.parametrize("g", [-1.5, -0.2, 0.0, 0.2, 1.5])
@pytest.mark.parametrize("dof", [6.0, math.inf])
def test_interval_ends_where_the_deviate_is_critical(g: float, dof: float) -> None:
    difference, sigma = np.array(0.3), 0.7
    variance, third = np.array(sigma**2), np.array(g * sigma**3)
    low, high = skew_interval(difference, variance, third, np.array(dof), 0.05)
    for end in (low, high):
        z = skew_deviate(difference - end, variance, third, np.array(dof))
        assert abs(float(z)) == pytest.approx(critical_deviate(0.025))
    assert low < difference < high


def test_tail_probability_and_critical_value_are_inverse() -> None:
    for level in (0.3, 1e-3, 1e-12):
        assert one_sided(critical_deviate(level)) == pytest.approx(level)
