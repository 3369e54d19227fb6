"""Deviates of skewed means: Hall's formula, its inverse, and the milder of two answers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from harness.stats.deviates import (
    Z_LIMIT,
    all_exceed,
    critical_deviate,
    largest_deviate,
    one_sided,
    skew_deviate,
    skew_interval,
)


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


class TestOfMany:
    """The shortcuts that spare the tail probabilities of most."""

    @pytest.fixture
    def cells(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Student's t of a thousand cells, and their degrees of freedom."""
        return rng.standard_t(8, 1000) + 1.0, rng.uniform(5, 60, 1000)

    def deviates(self, t: np.ndarray, dof: np.ndarray) -> np.ndarray:
        return np.array(stats.norm.isf(stats.t.sf(t, dof)))

    def test_the_largest_deviate_is_not_that_of_the_largest_t(self, cells: tuple[np.ndarray, np.ndarray]) -> None:
        assert largest_deviate(*cells) == pytest.approx(self.deviates(*cells).max())
        pair = np.array([3.2, 3.0]), np.array([5.0, math.inf])
        assert largest_deviate(*pair) == pytest.approx(3.0)
        assert largest_deviate(np.array([-1.0, math.nan]), np.array([9.0, 9.0])) == 0.0

    def test_all_exceed_up_to_the_smallest_and_no_further(self, cells: tuple[np.ndarray, np.ndarray]) -> None:
        t, dof = cells[0] - cells[0].min() + 2.0, cells[1]
        smallest = float(self.deviates(t, dof).min())
        assert all_exceed(t, dof, smallest - 1e-6)
        assert not all_exceed(t, dof, smallest + 1e-6)
        assert not all_exceed(np.append(t, math.nan), np.append(dof, 9.0), 0.1)
        assert all_exceed(np.array([2.0]), np.array([math.inf]), 1.96)
