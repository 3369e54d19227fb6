"""Bias verdicts on tiles: outcomes, places, and error rates under light, heavy and unequal tails."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from harness.errors import HarnessError
from harness.stats.levels import Looks, family_level
from harness.stats.sequential import Looking
from harness.stats.tiles import ImageMoments, TileAccumulator, TileSamples
from harness.stats.verdicts import (
    TESTS,
    TileVerdict,
    Tolerance,
    bias_outcome,
    bias_p_values,
    bias_verdict,
    tile_verdict,
)

SHAPE = (64, 80)
TILE = 16


def noisy(rng: np.random.Generator, truth: np.ndarray, sigma: float = 0.05, batches: int = 16,
          tile: int = TILE) -> TileSamples:
    """Batches of an image (H, W, 4) whose pixels have relative standard error `sigma` in the mean of all batches."""
    accumulator = TileAccumulator(tile)
    for _ in range(batches):
        accumulator.add(truth * (1 + sigma * np.sqrt(batches) * rng.standard_normal(truth.shape)), 8)
    return accumulator.samples()


def ones(height: int = SHAPE[0], width: int = SHAPE[1]) -> np.ndarray:
    return np.ones((height, width, 4))


def exact(image: np.ndarray, tile: int = TILE) -> TileSamples:
    return TileSamples.exact(image, tile)


class TestTiles:
    """Local defects."""

    def compare(self, rng: np.random.Generator, defect: np.ndarray, *, sigma: float = 0.05,
                tolerance: float = 0.05) -> TileVerdict:
        return tile_verdict(noisy(rng, defect, sigma), noisy(rng, ones(), sigma), tolerance)

    def test_defect_in_one_tile_is_found_and_placed(self, rng: np.random.Generator) -> None:
        defect = ones()
        defect[32:48, 16:32] = 1.10
        found = self.compare(rng, defect)
        assert found.outcome == "fail"
        assert found.worst == (2, 1)
        assert "x=16, y=32" in found.reason
        assert found.z[2, 1].min() > found.critical > np.delete(np.abs(found.z).max(-1).ravel(), 2 * 5 + 1).max()
        np.testing.assert_allclose(found.error[2, 1], 0.10, atol=0.02)
        assert (found.low < found.error).all() and (found.error < found.high).all()

    def test_dark_defect_has_negative_z(self, rng: np.random.Generator) -> None:
        defect = ones()
        defect[:16, 64:] = 0.9
        found = self.compare(rng, defect)
        assert (found.z[0, 4] < -found.critical).all()
        assert found.outcome == "fail"

    def test_agreement_passes_only_with_enough_samples(self, rng: np.random.Generator) -> None:
        assert self.compare(rng, ones(), sigma=0.05).outcome == "pass"
        assert self.compare(rng, ones(), sigma=0.5).outcome == "inconclusive"

    def test_defect_below_the_tolerance_is_tolerated(self, rng: np.random.Generator) -> None:
        """Plainly there (|z| beyond critical), yet smaller than what was asked about."""
        found = self.compare(rng, 1.03 * ones(), sigma=0.02)
        assert found.outcome == "pass"
        assert (found.z > found.critical).all()

    def test_z_is_error_over_its_standard_error(self) -> None:
        """Batches ±0.4 and ±0.3 about their means have standard errors 0.4 and 0.3 (of two): together 0.5."""
        def two(mean: float, spread: float) -> TileSamples:
            means = mean + spread * np.array([-1.0, 1.0])[:, None, None, None] * np.ones((1, 1, 2, 4))
            return TileSamples(means, np.array([4, 4]), 4, 4, 8)

        found = tile_verdict(two(6.0, 0.4), two(5.0, 0.3), 0.0)
        dof = 0.25**2 / (0.16**2 + 0.09**2)
        np.testing.assert_allclose(found.z, stats.norm.isf(stats.t.sf(1.0 / 0.5, dof)))
        level = 1 - 0.99**(1 / 8)
        assert found.critical == pytest.approx(stats.norm.isf(level / 2))
        np.testing.assert_allclose(found.smallest_detectable,
                                   (stats.t.isf(level / 2, dof) + stats.t.isf(0.05, dof)) * 0.5 / 5.0)

    def test_channels_are_judged_apart(self, rng: np.random.Generator) -> None:
        """Red up and blue down by the same luminance hides from luminance alone."""
        defect = ones()
        defect[:16, :16, :3] += 0.2 * np.array([0.0722, 0.0, -0.2126]) / 0.0722
        found = self.compare(rng, defect)
        assert found.outcome == "fail" and found.worst == (0, 0)
        assert "luminance" not in found.reason

    def test_dark_tile_is_measured_against_the_image(self) -> None:
        """Twice as bright as 1e-5 is no defect in an image whose mean is one."""
        truth = ones(32, 32)
        truth[:16, :16] = 1e-5
        test = truth.copy()
        test[:16, :16] = 2e-5
        found = tile_verdict(exact(test), exact(truth), 0.05)
        assert found.outcome == "pass"
        np.testing.assert_allclose(found.error[0, 0], 1e-5 / (0.01 * truth.mean()))

    def test_black_channel_is_measured_against_luminance(self) -> None:
        """In the light of a red lamp green is black, and a little of it is little."""
        truth = ones() * np.array([1.0, 0.0, 0.0, 0.2126])
        spill = truth + np.array([0.0, 1e-5, 0.0, 0.7e-5])
        assert bias_verdict(exact(spill), exact(truth)).outcome == "pass"
        assert bias_verdict(exact(truth + np.array([0.0, 0.01, 0.0, 0.007])), exact(truth)).outcome == "fail"

    def test_noisy_neighbour_costs_a_quiet_tile_little(self, rng: np.random.Generator) -> None:
        """Beside a lamp 100 times as bright, and as noisy for it, 10 % are still seen; so they are beside the dark."""
        for brightness in (100.0, 0.02):
            truth = ones()
            truth[:16, :16] = brightness
            defect = truth.copy()
            defect[:16, 16:32] *= 1.10
            found = tile_verdict(noisy(rng, defect), noisy(rng, truth), 0.0)
            assert found.outcome == "fail" and found.worst == (0, 1)

    @pytest.mark.parametrize("value", [np.nan, np.inf])
    def test_broken_pixel_fails_and_is_placed(self, rng: np.random.Generator, value: float) -> None:
        """A NaN in a render is a bug of the renderer; in the reference it is nobody's verdict."""
        image = ones()
        image[33, 21] = value
        good, broken = noisy(rng, ones()), noisy(rng, image)
        found = tile_verdict(broken, good, 0.05)
        assert found.outcome == "fail" and "x=16, y=32" in found.reason and "not finite" in found.reason
        assert tile_verdict(good, broken, 0.05).outcome == "inconclusive"
        assert bias_verdict(broken, good).outcome == "fail"

    def test_unknown_variance_is_inconclusive(self, rng: np.random.Generator) -> None:
        one = noisy(rng, ones(), batches=1)
        for test, reference in ((one, exact(ones())), (exact(ones()), one)):
            found = tile_verdict(test, reference, 0.05)
            assert found.outcome == "inconclusive" and "two batches" in found.reason
            assert np.isinf(found.smallest_detectable).all()

    def test_outcome_does_not_depend_on_the_unit_of_radiance(self, rng: np.random.Generator) -> None:
        test, reference = noisy(rng, ones()), noisy(rng, ones())
        bright = [TileSamples(1e6 * side.means, side.samples, TILE, *SHAPE) for side in (test, reference)]
        plain, scaled = bias_verdict(test, reference), bias_verdict(*bright)
        assert plain.outcome == scaled.outcome
        np.testing.assert_allclose(plain.fine.z, scaled.fine.z, rtol=1e-6)

    def test_nonsense_is_refused(self) -> None:
        image = exact(ones())
        for arguments, message in (((image, exact(ones(), 8), 0.1), "equal tiles"),
                                   ((image, exact(ones(32, 32)), 0.1), "equal tiles"),
                                   ((exact(np.ones((8, 8, 3))), exact(np.ones((8, 8, 3))), 0.1), "4 channels"),
                                   ((image, image, -0.1), r"tolerance .* found -0\.1")):
            with pytest.raises(HarnessError, match=message):
                tile_verdict(*arguments)
        with pytest.raises(HarnessError, match="error rate must lie"):
            tile_verdict(image, image, 0.1, fail_level=1.0)


class TestImage:
    """Three tests, one verdict."""

    def test_the_gravest_decides(self, rng: np.random.Generator) -> None:
        """0.5 % everywhere is far below what a tile may have; 5 % in 1 % of the image moves its mean by 0.05 %."""
        faint, local = 1.005 * ones(120, 120), ones(120, 120)
        local[40:52, 70:82] = 1.05
        truth = noisy(rng, ones(120, 120), 0.01, tile=6)
        tolerance = Tolerance(0.002, 0.0125, 0.025)
        by_mean, by_tile = (bias_verdict(noisy(rng, image, 0.01, tile=6), truth, tolerance)
                            for image in (faint, local))
        assert (by_mean.mean.outcome, by_mean.coarse.outcome, by_mean.fine.outcome) == ("fail", "pass", "pass")
        assert (by_tile.mean.outcome, by_tile.fine.outcome) == ("pass", "fail")
        assert by_mean.outcome == by_tile.outcome == "fail"
        assert by_mean.reason == by_mean.mean.reason and by_tile.reason == by_tile.fine.reason
        fine = bias_verdict(truth, exact(ones(120, 120), 6))
        assert fine.outcome == "pass" and fine.fine.error.shape == (20, 20, 4) and fine.coarse.error.shape == (5, 5, 4)

    def test_levels_are_shared(self) -> None:
        found = bias_verdict(exact(ones()), exact(ones()), fail_level=0.02)
        assert found.mean.fail_level == family_level(0.02, TESTS)
        assert found.outcome == "pass"

    def test_a_bias_of_the_tolerance_seldom_passes(self, rng: np.random.Generator) -> None:
        """At most `pass_level` / 2; 400 renders whose standard error is an eighth of the tolerance, all channels one.

        Those without a bias pass.
        """
        def share(bias: float) -> float:
            def side(mean: float) -> TileSamples:
                means = mean * (1 + 0.001 * rng.standard_normal((16, 1, 1, 1)) * np.ones((1, 1, 1, 4)))
                return TileSamples(means, np.ones(16), 20, 20, 20)

            return np.mean([tile_verdict(side(1 + bias), side(1.0), 0.0028, pass_level=0.2).outcome == "pass"
                            for _ in range(400)])

        assert share(0.0) > 0.99
        for bias in (0.0028, -0.0028):
            assert share(bias) < 0.1 + 3 * np.sqrt(0.1 * 0.9 / 400)


class TestLooking:
    """Looks at growing samples."""

    def test_a_look_has_its_share_of_both_rates(self, rng: np.random.Generator) -> None:
        sequence = Looking(Looks((8, 16, 32)), fail_level=0.04, pass_level=0.08)
        found = sequence.decide(0, exact(ones()), exact(ones()))
        assert found.fine.pass_level == pytest.approx(0.02)
        assert found.fine.fail_level == pytest.approx(family_level(0.01, TESTS))

    def test_a_gross_bug_fails_at_the_first_look_and_a_small_one_at_a_later(self, rng: np.random.Generator) -> None:
        """Growing batches of one run: standard errors of 0.2 %, 0.15 % and 0.1 %, excesses of 29 % and 0.4 %."""
        sequence = Looking(Looks((64, 128, 256)), Tolerance(0.01, 0.05, 0.1))

        def outcomes(bias: float) -> list[str]:
            run = noisy(rng, (1 + bias) * ones(), sigma=0.075, batches=64)
            return [sequence.decide(look, run.first(samples // 4), exact(ones())).outcome
                    for look, samples in enumerate(sequence.looks.samples)]

        assert outcomes(0.3)[0] == "fail"
        small = outcomes(0.014)
        assert small[0] == "inconclusive" and small[-1] == "fail"

    def test_the_outcome_alone_is_the_verdicts(self, rng: np.random.Generator) -> None:
        """From moments, for every outcome, values that are not finite and variances that are not known among them."""
        sequence = Looking(Looks((64, 128)), Tolerance(0.01, 0.05, 0.1))
        broken, single = ones(), noisy(rng, ones(), batches=1)
        broken[3, 3] = np.nan
        pairs = [(noisy(rng, (1 + bias) * ones(), sigma), reference) for bias in (0.0, 0.008, 0.02, -0.1)
                 for sigma in (0.02, 0.1, 0.5) for reference in (exact(ones()), noisy(rng, ones(), 0.05))]
        pairs += [(noisy(rng, broken), exact(ones())), (noisy(rng, ones()), exact(broken)), (single, exact(ones()))]
        outcomes = set()
        for test, reference in pairs:
            whole = sequence.decide(1, test, reference)
            moments = ImageMoments.of(test), ImageMoments.of(reference)
            assert sequence.outcome(1, *moments) == whole.outcome
            assert bias_p_values(*moments, sequence.tolerance) == (whole.mean.p, whole.coarse.p, whole.fine.p)
            assert bias_outcome(*moments, sequence.tolerance, fail_level=0.01, pass_level=0.05) == (
                bias_verdict(test, reference, sequence.tolerance).outcome)
            outcomes.add(whole.outcome)
        assert outcomes == {"pass", "fail", "inconclusive"}

    def test_the_outcome_follows_from_each_cell(self, rng: np.random.Generator) -> None:
        """Decided without the cells' maps, it is what these show: intervals within the tolerance, or one outside."""
        for sigma in (0.02, 0.06, 0.09, 0.12, 0.3):
            found = tile_verdict(noisy(rng, ones(), sigma, batches=64), exact(ones()), 0.05)
            inside = ((found.low >= -0.05) & (found.high <= 0.05)).all()
            assert found.outcome == ("pass" if inside else "inconclusive")
