"""Convergence fits: known laws come back, and intervals cover what they should."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from harness.errors import HarnessError
from harness.stats.convergence import Slope, band, fit_slope, slope_verdict, spp_to_reach

SPP = 2.0 ** np.arange(11)


def law(coefficients: list[float], slopes: list[float]) -> np.ndarray:
    """Errors (R, P) that follow coefficient x spp^slope exactly."""
    return np.array(coefficients)[:, None] * SPP ** np.array(slopes)[:, None]


def monte_carlo(rng: np.random.Generator, replicas: int, pixels: int = 64, power: int = 7) -> np.ndarray:
    """RMSE of prefixes of 1, 2, 4 … samples per pixel of normal noise, (replicas, power + 1)."""
    sums = rng.normal(size=(replicas, 2**power, pixels)).cumsum(axis=1)
    ends = 2 ** np.arange(power + 1)
    return np.sqrt(((sums[:, ends - 1] / ends[:, None])**2).mean(axis=2))


class TestFitSlope:
    """The exponent, its interval, and errors that have no logarithm."""

    def test_exact_law_comes_back(self) -> None:
        found = fit_slope(SPP, law([3.0, 3.0], [-0.5, -0.5]))
        assert found.slope == pytest.approx(-0.5, abs=1e-12)
        assert found.coefficient == pytest.approx(3.0)
        assert (found.low, found.high) == (pytest.approx(-0.5, abs=1e-9), pytest.approx(-0.5, abs=1e-9))
        assert (found.replicas, found.points) == (2, len(SPP))

    def test_squares_are_averaged_before_the_logarithm(self) -> None:
        """Replicas whose errors differ by a factor keep the slope; the coefficient is the root of the mean square."""
        found = fit_slope(SPP, law([1.0, 2.0, 4.0, 8.0], [-0.5] * 4))
        assert found.slope == pytest.approx(-0.5, abs=1e-9)
        assert found.coefficient == pytest.approx(math.sqrt(85 / 4))

    def test_interval_is_the_jackknifes(self) -> None:
        """Against pseudo-values written out by hand."""
        errors = law([1.0, 1.5, 0.8, 1.2], [-0.45, -0.50, -0.58, -0.49])
        found = fit_slope(SPP, errors, confidence=0.9)

        def slope(chosen: list[int]) -> float:
            return float(np.polyfit(np.log(SPP), 0.5 * np.log((errors[chosen] ** 2).mean(axis=0)), 1)[0])

        pseudo = [4 * slope([0, 1, 2, 3]) - 3 * slope([j for j in range(4) if j != i]) for i in range(4)]
        low, high = stats.t.interval(0.9, 3, np.mean(pseudo), stats.sem(pseudo))
        assert (found.slope, found.low, found.high) == pytest.approx((np.mean(pseudo), low, high))

    def test_heavy_tails_do_not_flatten_the_slope(self, rng: np.random.Generator) -> None:
        """1 sample in 10^4 carries all of a pixel's light. The mean of the replicas' own slopes is off by more than
        0.1 there, and its interval misses -1/2 in a quarter of runs; this one covers it in at least 9 of 10."""
        rarity, ends = 1e-4, 2 ** np.arange(11)
        counts = np.diff(ends, prepend=0)
        fits, naive = [], []
        for _ in range(60):
            hits = rng.poisson(rarity * counts[:, None, None], (11, 8, 4000)).cumsum(axis=0)
            errors = np.sqrt(((hits / rarity / ends[:, None, None] - 1) ** 2).mean(axis=2)).T
            fits.append(fit_slope(ends, errors))
            naive.append(np.polyfit(np.log(ends), np.log(errors).T, 1)[0].mean())
        assert np.mean([fit.low <= -0.5 <= fit.high for fit in fits]) >= 0.85
        assert np.mean([fit.slope for fit in fits]) == pytest.approx(-0.5, abs=0.05)
        assert np.mean(naive) > -0.4

    def test_monte_carlo_noise_has_slope_minus_one_half(self, rng: np.random.Generator) -> None:
        """And the 95 % interval over 6 replicas covers it in 95 % of 300 studies, though prefixes share samples."""
        fits = [fit_slope(2.0 ** np.arange(8), monte_carlo(rng, 6)) for _ in range(300)]
        covered = np.mean([fit.low <= -0.5 <= fit.high for fit in fits])
        assert abs(covered - 0.95) < 4 * math.sqrt(0.95 * 0.05 / 300)
        assert np.mean([fit.slope for fit in fits]) == pytest.approx(-0.5, abs=0.005)

    def test_single_replica_has_a_slope_but_no_interval(self) -> None:
        found = fit_slope(SPP, law([1.0], [-0.4])[0])
        assert found.slope == pytest.approx(-0.4)
        assert (found.low, found.high) == (-math.inf, math.inf)
        assert slope_verdict(found) == "inconclusive"

    def test_prefix_with_a_vanished_error_is_left_out_of_all_replicas(self) -> None:
        """Near the noise of the reference some errors are clipped to zero; the others there were lucky to be high."""
        rmse = law([1.0, 1.0, 1.0], [-0.5, -0.5, -0.5])
        rmse[0, -1] = 0.0
        rmse[1:, -1] *= 3.0
        rmse[2, 0] = np.nan
        found = fit_slope(SPP, rmse)
        assert found.slope == pytest.approx(-0.5, abs=1e-12)
        assert found.points == len(SPP) - 2

    @pytest.mark.parametrize("left", [0, 1])
    def test_errors_that_vanish_have_no_slope(self, left: int) -> None:
        """No point or one is no line."""
        rmse = np.zeros((3, len(SPP)))
        rmse[:, :left] = 1.0
        found = fit_slope(SPP, rmse)
        assert math.isnan(found.slope) and found.points == left
        assert (found.low, found.high) == (-math.inf, math.inf)
        assert slope_verdict(found) == "inconclusive"

    @pytest.mark.parametrize(("spp", "rmse", "message"), [
        (SPP, np.ones((2, 3)), "one for each spp"),
        (np.array([0.0, 1.0]), np.ones((2, 2)), "must be positive"),
    ])
    def test_nonsense_is_refused(self, spp: np.ndarray, rmse: np.ndarray, message: str) -> None:
        with pytest.raises(HarnessError, match=message):
            fit_slope(spp, rmse)


@pytest.mark.parametrize(("low", "high", "outcome"), [
    (-0.52, -0.48, "pass"),
    (-0.55, -0.45, "pass"),
    (-0.44, -0.40, "fail"),
    (-0.60, -0.56, "fail"),
    (-0.56, -0.48, "inconclusive"),
    (-0.70, -0.30, "inconclusive"),  # contains -1/2, and says nothing
])
def test_slope_verdict_is_equivalence_and_not_mere_agreement(low: float, high: float, outcome: str) -> None:
    assert slope_verdict(Slope((low + high) / 2, low, high, 0.95, 8, 1.0, 11)) == outcome


class TestSppToReach:
    """Samples at equal error."""

    def test_solves_the_law(self) -> None:
        """2 x N^(-1/2) = 0.1 at N = 400, also beyond the range measured; no scatter, no interval."""
        assert spp_to_reach(SPP, law([2.0, 2.0], [-0.5, -0.5]), 0.1) == pytest.approx((400, 400, 400))
        assert spp_to_reach(SPP, law([2.0, 2.0], [-0.5, -0.5]), 0.01) == pytest.approx((40000, 40000, 40000))

    def test_scattered_replicas_cost_what_their_mean_square_costs(self) -> None:
        """Mean squares 1, 4 and 16 average to 7, which falls to 0.01 at N = 700; the interval lies about it."""
        value, low, high = spp_to_reach(SPP, law([1.0, 2.0, 4.0], [-0.5] * 3), 0.1)
        assert value == pytest.approx(700)
        assert low < 700 < high

    def test_error_that_does_not_fall_never_gets_there(self) -> None:
        assert spp_to_reach(SPP, law([1.0, 1.0], [-0.5, 0.01]), 0.1) == (math.inf, math.inf, math.inf)

    def test_single_replica_has_a_value_and_no_interval(self) -> None:
        value, low, high = spp_to_reach(SPP, law([2.0], [-0.5]), 0.1)
        assert value == pytest.approx(400)
        assert (low, high) == (0.0, math.inf)

    def test_nothing_to_fit_gives_nan(self) -> None:
        assert all(math.isnan(x) for x in spp_to_reach(SPP, np.zeros((2, len(SPP))), 0.1))

    @pytest.mark.parametrize("target", [0.0, -1.0, math.inf, math.nan])
    def test_target_must_be_positive(self, target: float) -> None:
        with pytest.raises(HarnessError, match="error to reach must be positive"):
            spp_to_reach(SPP, law([1.0], [-0.5]), target)


class TestBand:
    """Confidence bands of curves."""

    def test_arithmetic_band_is_student_over_replicas(self, rng: np.random.Generator) -> None:
        values = rng.normal(size=(5, 3))
        mean, low, high = band(values, 0.9)
        np.testing.assert_allclose(mean, values.mean(0))
        expected = stats.t.interval(0.9, 4, values.mean(0), stats.sem(values))
        np.testing.assert_allclose((low, high), expected)

    def test_geometric_band_is_that_of_logarithms(self, rng: np.random.Generator) -> None:
        values = rng.lognormal(size=(5, 3))
        mean, low, high = band(values, geometric=True)
        np.testing.assert_allclose(mean, stats.gmean(values))
        np.testing.assert_allclose((low, high), np.exp(band(np.log(values))[1:]))
        assert (low > 0).all()

    def test_vanished_error_is_a_gap_in_a_geometric_band(self) -> None:
        mean, low, high = band(np.array([[1.0, 0.0], [2.0, 1.0]]), geometric=True)
        assert np.isfinite([mean[0], low[0], high[0]]).all()
        assert np.isnan([mean[1], low[1], high[1]]).all()

    @pytest.mark.parametrize("geometric", [False, True])
    def test_single_replica_has_a_curve_and_no_band(self, geometric: bool) -> None:
        mean, low, high = band(np.array([[1.0, 4.0]]), geometric=geometric)
        np.testing.assert_allclose(mean, [1.0, 4.0])
        assert np.isnan(low).all() and np.isnan(high).all()

    def test_confidence_is_a_fraction(self) -> None:
        with pytest.raises(HarnessError, match="confidence must lie between 0 and 1"):
            band(np.ones((2, 2)), 95)
