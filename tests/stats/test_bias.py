"""Bias verdicts: intervals as the textbooks have them, and error rates as measured by simulation."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats

from harness.errors import HarnessError
from harness.estimate import LUMINANCE
from harness.stats.bias import (
    Z_LIMIT,
    MeanErrorVerdict,
    TileVerdict,
    error_scale,
    mean_error_verdict,
    tile_sums,
    tile_verdict,
)

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


def noisy_image(rng: np.random.Generator, truth: np.ndarray, sigma: float,
                batches: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixel means with standard error sigma x truth, and their variances as estimated from that many batches."""
    variance = (sigma * truth)**2
    dof = batches - 1
    return rng.normal(truth, np.sqrt(variance)), variance * rng.chisquare(dof, truth.shape) / dof


class TestTiles:
    """Local defects."""

    SHAPE = (64, 80)

    def compare(self, rng: np.random.Generator, test_truth: np.ndarray, reference_truth: np.ndarray, *,
                sigma: float = 0.05, batches: int = 16, **options: float) -> TileVerdict:
        test, reference = (noisy_image(rng, truth, sigma, batches) for truth in (test_truth, reference_truth))
        return tile_verdict(*test, batches - 1, *reference, batches - 1, **options)

    @pytest.mark.parametrize("batches", [4, 32])
    def test_unbiased_render_fails_as_often_as_stated(self, rng: np.random.Generator, batches: int) -> None:
        """With no tolerance, the largest of 20 tiles exceeds the critical value in 5 % of 1000 experiments."""
        truth = np.linspace(0.2, 2.0, self.SHAPE[0] * self.SHAPE[1]).reshape(self.SHAPE)
        trials = 1000
        rate = sum(self.compare(rng, truth, truth, batches=batches, tolerance=0.0).outcome == "fail"
                   for _ in range(trials)) / trials
        assert abs(rate - 0.05) < 4 * math.sqrt(0.05 * 0.95 / trials)

    def test_defect_in_one_tile_is_found_and_placed(self, rng: np.random.Generator) -> None:
        truth = np.ones(self.SHAPE)
        defect = truth.copy()
        defect[32:48, 16:32] = 1.10
        found = self.compare(rng, defect, truth)
        assert found.outcome == "fail"
        assert found.worst == (2, 1)
        assert "x=16, y=32" in found.reason
        assert found.z[2, 1] > found.critical > np.delete(found.z.ravel(), 2 * 5 + 1).max()
        assert abs(found.error[2, 1] - 0.10) < 0.02

    def test_dark_defect_has_negative_z(self, rng: np.random.Generator) -> None:
        truth = np.ones(self.SHAPE)
        defect = truth.copy()
        defect[:16, 64:] = 0.9
        found = self.compare(rng, defect, truth)
        assert found.z[0, 4] < -found.critical
        assert found.outcome == "fail"

    def test_agreement_passes_only_with_enough_samples(self, rng: np.random.Generator) -> None:
        truth = np.ones(self.SHAPE)
        assert self.compare(rng, truth, truth, sigma=0.05).outcome == "pass"
        assert self.compare(rng, truth, truth, sigma=0.5).outcome == "inconclusive"
        perfect = tile_verdict(truth, 9 * truth, 15, truth, 9 * truth, 15)
        assert perfect.outcome == "inconclusive" and not perfect.error.any()

    def test_defect_below_the_tolerance_is_tolerated(self, rng: np.random.Generator) -> None:
        """Plainly there (|z| beyond critical), yet smaller than what was asked about."""
        truth = np.ones(self.SHAPE)
        found = self.compare(rng, 1.03 * truth, truth, sigma=0.02, tolerance=0.05)
        assert found.outcome == "pass"
        assert (found.z > found.critical).all()

    def test_z_is_error_over_its_standard_error(self) -> None:
        """With known variances; the two sides add: sqrt(0.0016 + 0.0009) = 0.05 a pixel, 0.05/4 a tile of 16."""
        shape = (4, 8)
        found = tile_verdict(np.full(shape, 1.025), np.full(shape, 0.0016), math.inf, np.ones(shape),
                             np.full(shape, 0.0009), math.inf, tile=4)
        np.testing.assert_allclose(found.z, np.full((1, 2), 0.025 / (0.05 / 4)), rtol=1e-6)
        np.testing.assert_allclose(found.critical, stats.norm.ppf(1 - (1 - 0.95**0.5) / 2), rtol=1e-9)
        assert found.smallest_detectable[0, 0] == pytest.approx((found.critical + stats.norm.ppf(0.95)) * 0.05 / 4)

    def test_tiles_at_the_edges_may_be_smaller(self) -> None:
        image = np.arange(5 * 7.0).reshape(5, 7)
        sums = tile_sums(image, 4)
        expected = [[image[:4, :4].sum(), image[:4, 4:].sum()], [image[4:, :4].sum(), image[4:, 4:].sum()]]
        np.testing.assert_array_equal(sums, expected)
        found = tile_verdict(image + 1, 0 * image, math.inf, image + 1, 0 * image, math.inf, tile=4)
        assert found.error.shape == (2, 2) and found.outcome == "pass"

    def test_channels_are_judged_apart(self, rng: np.random.Generator) -> None:
        """Red up and blue down by the same luminance hides from luminance alone."""
        truth = np.ones((*self.SHAPE, 3))
        defect = truth.copy()
        defect[:16, :16] += 0.2 * np.array([0.0722, 0.0, -0.2126]) / 0.0722
        found = self.compare(rng, defect, truth)
        assert found.z.shape == (4, 5, 3)
        assert found.outcome == "fail" and found.worst == (0, 0)

    def test_dark_tile_is_measured_against_the_image(self) -> None:
        """Twice as bright as 1e-5 is no defect in an image whose mean is one."""
        truth = np.ones((32, 32))
        truth[:16, :16] = 1e-5
        test = truth.copy()
        test[:16, :16] = 2e-5
        found = tile_verdict(test, 0 * truth, math.inf, truth, 0 * truth, math.inf)
        assert found.outcome == "pass"
        assert found.error[0, 0] == pytest.approx(1e-5 / (0.01 * truth.mean()))

    def test_broken_pixel_fails_and_is_placed(self, rng: np.random.Generator) -> None:
        truth = np.ones(self.SHAPE)
        test = truth.copy()
        test[33, 21] = np.nan
        found = tile_verdict(test, 0 * truth, 9, truth, 0 * truth, 9)
        assert found.outcome == "fail" and "x=21, y=33" in found.reason
        assert found.worst == (2, 1)

    def test_unknown_variance_is_inconclusive(self) -> None:
        truth = np.ones(self.SHAPE)
        found = tile_verdict(truth, truth * np.nan, 0, truth, 0 * truth, math.inf)
        assert found.outcome == "inconclusive" and "two batches" in found.reason
        assert np.isinf(found.smallest_detectable).all()

    def test_z_saturates_instead_of_overflowing(self) -> None:
        """An exact image that is wrong is infinitely many standard errors off; the picture of it stays finite."""
        truth = np.ones((16, 16))
        found = tile_verdict(1.5 * truth, 0 * truth, math.inf, truth, 0 * truth, math.inf)
        assert found.z[0, 0] == Z_LIMIT and found.outcome == "fail"

    def test_tile_of_no_pixels_is_refused(self) -> None:
        with pytest.raises(HarnessError, match="tile size must be at least 1"):
            tile_verdict(np.ones((4, 4)), np.ones((4, 4)), 9, np.ones((4, 4)), np.ones((4, 4)), 9, tile=0)


def test_unequal_tails_mislead_the_tiles_but_not_the_mean(rng: np.random.Generator) -> None:
    """The limit that the docstring admits, so that nobody trusts the tiles further than they reach.

    One side is normal, the other draws samples that are 1000 times brighter with probability 1e-4; same mean.
    """
    batches, spp, side, trials = 16, 8, 64, 60
    rare, bright = 1e-4, 1000.0
    tiles = means = 0
    for _ in range(trials):
        smooth = rng.normal(1.0, 1.0, (batches, side, side)) / math.sqrt(spp) + (1 - 1 / math.sqrt(spp))
        fireflies = (1 - rare * bright) + bright * rng.binomial(spp, rare, (batches, side, side)) / spp
        sides = [(image.mean(0), image.var(0, ddof=1) / batches) for image in (fireflies, smooth)]
        tiles += tile_verdict(*sides[0], batches - 1, *sides[1], batches - 1, tolerance=0.0).outcome == "fail"
        (test, test_var), (reference, reference_var) = [
            (np.full(4, image.mean()), np.full(4, image.mean((1, 2)).var(ddof=1) / batches))
            for image in (fireflies, smooth)]
        means += mean_error_verdict(test, test_var, batches - 1, reference, reference_var, batches - 1,
                                    tolerance=0.0).outcome == "fail"
    assert tiles / trials > 0.10
    assert means / trials < 0.10


@pytest.mark.parametrize("judge", [mean_error_verdict, tile_verdict])
def test_outcome_does_not_depend_on_the_unit_of_radiance(judge: Callable[..., MeanErrorVerdict | TileVerdict],
                                                         rng: np.random.Generator) -> None:
    """A scene a million times brighter gets the same verdict, error for error."""
    shape = (4,) if judge is mean_error_verdict else (16, 16)
    test, reference = rng.uniform(0.9, 1.1, shape), np.ones(shape)
    plain = judge(test, 1e-4 * reference, 9, reference, 1e-4 * reference, 9)
    bright = judge(1e6 * test, 1e8 * reference, 9, 1e6 * reference, 1e8 * reference, 9)
    assert plain.outcome == bright.outcome
    np.testing.assert_allclose(plain.error, bright.error, rtol=1e-9)
