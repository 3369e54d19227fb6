"""Bias verdicts: intervals as the textbooks have them, and error rates as measured by simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from harness.errors import HarnessError
from harness.samples.estimate import LUMINANCE
from harness.stats.bias import MeanErrorVerdict, error_scale, mean_error_verdict

ONE = np.ones(4)
GREY = 0.5 * ONE


def verdict(error: float, sigma: float, *, tolerance: float = 0.002, dof: float = math.inf) -> MeanErrorVerdict:
    """The verdict on a grey image that is off by `error`, with standard error `sigma`, against an exact reference."""
    return mean_error_verdict(GREY * (1 + error), (GREY * sigma)**2, dof, GREY, 0 * ONE, math.inf, tolerance=tolerance)


class TestMeanErrorInterval:
    """The estimate of the error and its interval."""

    def test_interval_is_welch_satterthwaite_on_a_ratio(self) -> None:
        """Delta method for the ratio 1.01/1, worked out by hand."""
        found = mean_error_verdict(1.01 * ONE, 1e-6 * ONE, 10, ONE, 4e-6 * ONE, 5, confidence=0.9)
        from_test, from_reference = 1e-6, 1.01**2 * 4e-6
        dof = (from_test + from_reference)**2 / (from_test**2 / 10 + from_reference**2 / 5)
        half = stats.t.ppf(0.95, dof) * math.sqrt(from_test + from_reference)
        np.testing.assert_allclose(found.error, 0.01, rtol=1e-12)
        np.testing.assert_allclose(found.dof, dof, rtol=1e-12)
        np.testing.assert_allclose(found.low, 0.01 - half, rtol=1e-9)
        np.testing.assert_allclose(found.high, 0.01 + half, rtol=1e-9)

    def test_error_is_relative_to_each_channel(self) -> None:
        reference = np.array([1.0, 2.0, 4.0, 3.0])
        found = mean_error_verdict(reference + 0.1, 0 * ONE, math.inf, reference, 0 * ONE, math.inf)
        np.testing.assert_allclose(found.error, 0.1 / reference, rtol=1e-12)

    def test_exact_reference_leaves_the_dof_of_the_test(self) -> None:
        np.testing.assert_allclose(verdict(0.0, 0.001, dof=7).dof, 7)

    def test_infinite_dof_gives_the_normal_interval(self) -> None:
        found = verdict(0.0, 0.001)
        np.testing.assert_allclose(found.high, 0.001 * stats.norm.ppf(0.975), rtol=1e-9)

    def test_black_channel_is_measured_against_luminance(self) -> None:
        """A red light leaves green and blue black, where a relative error means nothing."""
        reference = np.array([1.0, 0.0, 0.0, 0.2126])
        np.testing.assert_allclose(error_scale(reference), [1.0, 0.2126, 0.2126, 0.2126])
        spill = np.array([0.0, 0.01, 0.0, 0.0])
        found = mean_error_verdict(reference + spill, 1e-12 * ONE, 9, reference, 1e-12 * ONE, 9)
        np.testing.assert_allclose(found.error, [0.0, 0.01 / 0.2126, 0.0, 0.0], atol=1e-12)
        np.testing.assert_allclose((found.high - found.error)[1] / (found.high - found.error)[2], 1.0, rtol=1e-9)
        assert found.outcome == "fail" and "green" in found.reason

    def test_black_reference_is_measured_in_radiance(self) -> None:
        found = mean_error_verdict(0.03 * ONE, 0 * ONE, math.inf, 0 * ONE, 0 * ONE, math.inf)
        np.testing.assert_allclose(found.error, 0.03)
        assert found.outcome == "fail"

    def test_interval_covers_the_true_ratio_at_its_confidence(self, rng: np.random.Generator) -> None:
        """Unequal variances and few batches on both sides; 4000 experiments, the bound is four standard errors."""
        trials, true = 4000, 1.05
        covered = 0
        for _ in range(trials):
            test, reference = rng.normal(true, 0.02, (6, 4)), rng.normal(1.0, 0.05, (10, 4))
            found = mean_error_verdict(test.mean(0), test.var(0, ddof=1) / 6, 5,
                                       reference.mean(0), reference.var(0, ddof=1) / 10, 9)
            covered += int(((found.low <= true - 1) & (true - 1 <= found.high)).sum())
        assert abs(covered / (4 * trials) - 0.95) < 4 * math.sqrt(0.95 * 0.05 / (4 * trials))


class TestMeanErrorOutcome:
    """Which verdict, and why."""

    @pytest.mark.parametrize(("error", "sigma", "outcome"), [
        (0.0005, 0.0005, "pass"),
        (-0.0005, 0.0005, "pass"),
        (0.01, 0.001, "fail"),
        (-0.01, 0.001, "fail"),
        (0.0, 0.01, "inconclusive"),  # far too noisy, however well the means agree
        (0.0025, 0.001, "inconclusive"),  # beyond the tolerance, but perhaps by chance
        (0.0043, 0.001, "inconclusive"),  # outside at 95 %, but not once four channels are allowed for
        (0.0, 0.0, "pass"),
    ])
    def test_outcome_follows_the_interval(self, error: float, sigma: float, outcome: str) -> None:
        assert verdict(error, sigma).outcome == outcome

    def test_one_bad_channel_is_enough_to_fail(self) -> None:
        test = GREY * np.array([1.0, 1.0, 1.02, 1.001])
        found = mean_error_verdict(test, (0.0005 * GREY)**2, 30, GREY, 0 * ONE, math.inf)
        assert found.outcome == "fail"
        assert "blue +2 %" in found.reason

    def test_unknown_variance_is_inconclusive(self) -> None:
        """A single batch says nothing of its own noise; dof 0 comes with it."""
        unknown = np.full(4, np.nan)
        for arguments in ((GREY, unknown, 0, GREY, 0 * ONE, math.inf), (GREY, 0 * ONE, 9, GREY, unknown, 0)):
            found = mean_error_verdict(*arguments)
            assert found.outcome == "inconclusive"
            assert "two batches" in found.reason
            assert np.isinf(found.smallest_detectable).all()
            np.testing.assert_allclose(found.error, 0.0)

    def test_test_image_that_is_not_finite_fails(self) -> None:
        """A NaN in a render is a bug of the renderer; in the reference it is nobody's verdict."""
        broken = GREY * np.array([1, np.nan, 1, np.nan])
        assert mean_error_verdict(broken, ONE * np.nan, 9, GREY, 0 * ONE, 9).outcome == "fail"
        assert mean_error_verdict(GREY, 0 * ONE, 9, broken, ONE * np.nan, 9).outcome == "inconclusive"

    def test_inconclusive_says_how_many_samples_would_decide(self) -> None:
        """The interval must shrink from 0.0049 to 0.002 - 0.001, so about 24 times the samples."""
        assert "about 24 times the samples" in verdict(0.001, 0.0025).reason
        assert "test image" in verdict(0.001, 0.0025).reason

    def test_nonsense_levels_are_refused(self) -> None:
        with pytest.raises(HarnessError, match=r"tolerance .* found -0\.1"):
            verdict(0.0, 0.1, tolerance=-0.1)
        with pytest.raises(HarnessError, match="confidence must lie between 0 and 1"):
            mean_error_verdict(GREY, ONE, 9, GREY, ONE, 9, confidence=95)
        with pytest.raises(HarnessError, match="error rate must lie between 0 and 1"):
            mean_error_verdict(GREY, ONE, 9, GREY, ONE, 9, fail_level=0.0)


class TestMeanErrorRates:
    """How often chance misleads the verdict: simulated renders whose channels share most of their noise."""

    TRIALS = 2000
    BATCHES = 12

    def share(self, rng: np.random.Generator, bias: float, tolerance: float, outcome: str, *,
              grey: bool = False) -> float:
        """The share of experiments that end in `outcome` for a render with a relative bias."""
        count = 0
        for _ in range(self.TRIALS):
            means = []
            for factor in (1 + bias, 1.0):
                common = rng.gamma(4.0, 0.25, (self.BATCHES, 1))
                own = common if grey else 0.7 * common + 0.3 * rng.gamma(4.0, 0.25, (self.BATCHES, 3))
                rgb = factor * (1 + 0.01 * (np.broadcast_to(own, (self.BATCHES, 3)) - 1))
                means.append(np.concatenate([rgb, (rgb @ LUMINANCE)[:, None]], axis=1))
            test, reference = means
            found = mean_error_verdict(
                test.mean(0), test.var(0, ddof=1) / self.BATCHES, self.BATCHES - 1, reference.mean(0),
                reference.var(0, ddof=1) / self.BATCHES, self.BATCHES - 1, tolerance=tolerance)
            count += found.outcome == outcome
        return count / self.TRIALS

    def test_unbiased_render_fails_no_more_often_than_stated(self, rng: np.random.Generator) -> None:
        """Even with no tolerance at all, where every departure counts; Bonferroni keeps it below 5 %, not far below."""
        assert 0.01 < self.share(rng, 0.0, 0.0, "fail") < 0.05

    def test_bias_as_large_as_the_tolerance_seldom_passes(self, rng: np.random.Generator) -> None:
        """At most (1 - confidence) / 2 = 2.5 %; the noise is small enough for passes to be possible."""
        # Standard error of the ratio: 0.01 * gamma's 0.5 * sqrt(2/12) = 0.0020, so tolerance is five of them.
        assert self.share(rng, 0.010, 0.010, "pass", grey=True) < 0.025 + 4 * math.sqrt(0.025 * 0.975 / self.TRIALS)
        assert self.share(rng, 0.0, 0.010, "pass", grey=True) > 0.9

    def test_smallest_detectable_bias_is_found_with_its_power(self, rng: np.random.Generator) -> None:
        """Noise known exactly and common to all channels, so that the verdict is a single z-test of known power."""
        sigma, trials = 0.001, 4000
        size = verdict(0.0, sigma, tolerance=0.0).smallest_detectable[0]
        found = sum(verdict(size + sigma * noise, sigma, tolerance=0.0).outcome == "fail"
                    for noise in rng.normal(size=trials))
        assert abs(found / trials - 0.95) < 4 * math.sqrt(0.95 * 0.05 / trials)


def test_outcome_does_not_depend_on_the_unit_of_radiance(rng: np.random.Generator) -> None:
    """A scene a million times brighter gets the same verdict, error for error."""
    test, reference = rng.uniform(0.9, 1.1, 4), np.ones(4)
    plain = mean_error_verdict(test, 1e-4 * reference, 9, reference, 1e-4 * reference, 9)
    bright = mean_error_verdict(1e6 * test, 1e8 * reference, 9, 1e6 * reference, 1e8 * reference, 9)
    assert plain.outcome == bright.outcome
    np.testing.assert_allclose(plain.error, bright.error, rtol=1e-9)
