"""Verdicts on differences: what they see, what they allow for, and how often they err where partings are rare."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import stats

from harness.errors import HarnessError
from harness.stats.calibration import COUPLED_GAINS, coupled, coupled_power, false_alarms
from harness.stats.channels import Channel
from harness.stats.contrasts import PairedContrast, PairedMoments
from harness.stats.levels import Looks
from harness.stats.paired import (
    COUPLED,
    FLOAT32_FLOOR,
    TIGHT,
    PairedLooking,
    largest_samples,
    paired,
    paired_verdict,
)
from harness.stats.partings import PARTINGS, Parting, bias, draw_pair
from harness.stats.synthetic import Plan, with_gain
from harness.stats.tiles import TileAccumulator, TileSamples
from harness.stats.verdicts import Tolerance, bias_verdict, contrast_verdict

PLAN = Plan(side=60, batches=32, spp=64)
LOOKS = Looks((512, 1024, 2048))
# One tile of 400 pixels, 32 batches of 64 samples each: what n is below.
TILE, BATCHES, SPP = 20, 32, 64
DRAWN = TILE**2 * BATCHES * SPP


def pair(rng: np.random.Generator, expected: float, kind: str = "even", plan: Plan = PLAN,
         drift: np.ndarray | float = 0.0) -> tuple[TileSamples, TileSamples]:
    return draw_pair(PARTINGS[kind], plan, expected, rng, drift=drift)


def one_tile(rng: np.random.Generator, expected: float) -> tuple[TileSamples, TileSamples]:
    """A reference of mean 1 and largest sample 1, and a test of which samples part now and then: always upwards."""
    means = 1 + 0.001 * rng.standard_normal((BATCHES, 1, 1, 4))
    parted = rng.poisson(expected / BATCHES, (BATCHES, 1, 1, 1)) * BATCHES / DRAWN
    reference = TileSamples(means, np.full(BATCHES, SPP), TILE, TILE, TILE, np.ones_like(means))
    return dataclasses.replace(reference, means=means + parted), reference


class TestCoverage:
    """The interval of a mean that has seen about one parting."""

    @pytest.mark.parametrize("expected", [0.1, 1.0, 3.0])
    def test_is_broken_without_what_is_unseen_and_right_with_it(self, rng: np.random.Generator,
                                                                expected: float) -> None:
        """200 runs; the truth is `expected` partings, of which there are none in exp(-`expected`) of the runs."""
        truth, bare, allowed, three = expected / DRAWN, 0, 0, 0
        for _ in range(200):
            test, reference = one_tile(rng, expected)
            contrast = next(paired(test, reference))
            found = contrast_verdict(contrast, TILE, 0.1, fail_level=0.01, pass_level=0.05)
            low, high, unseen = (float(values[0, 0, 3]) for values in (found.low, found.high, contrast.unseen(0.05)))
            allowed += low <= truth <= high
            seen = dataclasses.replace(contrast, single=np.zeros_like(contrast.single)).interval(0.05)
            bare += float(seen[0][0, 0, 3]) <= truth <= float(seen[1][0, 0, 3])
            three += unseen >= 3 / DRAWN * 0.99
        assert bare < (1 - np.exp(-expected)) * 200 + 20
        assert allowed >= 0.97 * 200
        assert three == 200

    def test_what_is_unseen_is_the_rule_of_three(self) -> None:
        """-ln(0.05) = 3.0 at one side's 5 %, in units of the tile's mean of 2; of samples no larger than 4."""
        means = np.full((8, 1, 1, 4), 2.0)
        side = TileSamples(means, np.full(8, 10.0), 5, 5, 5, np.full_like(means, 4.0))
        contrast = next(paired(side, side))
        np.testing.assert_allclose(contrast.unseen(0.1), 2.9957 * 4 / (25 * 80) / 2, rtol=1e-4)
        np.testing.assert_allclose(contrast.interval(0.1)[1], contrast.unseen(0.1), rtol=1e-9)

    @pytest.mark.parametrize("parted", [1, 2, 3, 6, 12, 25])
    def test_of_partings_of_one_size_the_interval_is_poissons(self, parted: int) -> None:
        """Garwood (1936): the mean of which so few partings, or fewer, come with a probability of 2.5 %."""
        exact, batches = float(stats.gamma(parted + 1).ppf(0.975)), 1000
        jumps = np.zeros((batches, 1, 1, 4))
        jumps[:parted] = 1 / TILE**2
        means = np.ones_like(jumps)
        reference = TileSamples(means, np.ones(batches), TILE, TILE, TILE, means)
        _, high = next(paired(dataclasses.replace(reference, means=means + jumps), reference)).interval(0.05)
        assert high[0, 0, 3] * TILE**2 * batches == pytest.approx(exact, abs=0.25)


class TestPass:
    """A pass is a promise about what has not been seen."""

    def test_a_bias_of_the_tolerance_in_partings_alone_seldom_passes(self, rng: np.random.Generator) -> None:
        """Three partings expected, all upwards, which make a bias of just the tolerance: none comes in 5 % of runs."""
        tolerance = 3 / DRAWN
        blind = passed = 0
        for _ in range(200):
            test, reference = one_tile(rng, 3.0)
            contrast = next(paired(test, reference))
            unaware = dataclasses.replace(contrast, single=np.zeros_like(contrast.single))
            options = {"fail_level": 0.01, "pass_level": 0.05}
            blind += contrast_verdict(unaware, TILE, tolerance, **options).outcome == "pass"
            passed += contrast_verdict(contrast, TILE, tolerance, **options).outcome == "pass"
        assert blind > 0.04 * 200
        assert passed == 0

    @pytest.mark.parametrize("expected", [3.75, 8.0, 25.0, 160.0])
    def test_at_no_number_of_partings_a_bias_of_the_tolerance_passes_too_often(self, rng: np.random.Generator,
                                                                               expected: float) -> None:
        """1,000 runs side by side as tiles, with three looks, all partings upwards and as large as can be, that make a
        bias of the tolerance: at these numbers of them most pass. 2.5 % may; by chance at most 38 of 1,000 then do."""
        runs, batches = 1000, 64
        bias = expected / (BATCHES * TILE**2 * batches)
        jumps = rng.poisson(expected / batches, (batches, 1, runs, 1)) * batches * bias / expected * np.ones(4)
        means = np.ones_like(jumps)
        reference = TileSamples(means, np.full(batches, BATCHES), TILE, TILE, TILE * runs, means)
        test = dataclasses.replace(reference, means=means + jumps)
        looks = Looks((16, 32, 64))
        passed = np.zeros(runs, bool)
        for look, drawn in enumerate(looks.samples):
            moments = PairedMoments.of(test.first(drawn), reference.first(drawn))
            contrast = PairedContrast.of(moments, means[0], 0.05)
            alone = dataclasses.replace(contrast, lent=np.zeros_like(contrast.lent))  # tiles are runs, not neighbours
            low, high = alone.interval(looks.level(look, 0.05))
            passed |= ((-bias <= low) & (high <= bias))[0, :, 3]
        assert passed.sum() <= 38

    def test_takes_samples_even_where_nothing_differs(self, rng: np.random.Generator) -> None:
        """Equal images pass the mean at once, and smaller tiles only once no parting can matter to them."""
        _, reference = pair(rng, 0.0)
        few = reference.first(8)
        tolerance = Tolerance(COUPLED.mean, COUPLED.coarse, TIGHT.fine)
        found = paired_verdict(few, few, tolerance)
        assert (found.mean.outcome, found.fine.outcome) == ("pass", "inconclusive")
        assert "for samples that have not come yet" in found.reason
        assert paired_verdict(reference, reference, tolerance).outcome == "pass"

    def test_what_is_unseen_does_not_stand_in_fail(self, rng: np.random.Generator) -> None:
        """A gain of six tolerances of everything, at a look where no smaller tile can pass."""
        test, reference = pair(rng, 1.0)
        few = [with_gain(test, 6 * TIGHT.mean).first(8), reference.first(8)]
        contrast = tuple(paired(*few))[2]
        assert contrast.unseen(0.05).min() > TIGHT.fine
        found = paired_verdict(*few, TIGHT)
        assert found.outcome == found.mean.outcome == "fail"


class TestSight:
    """What differences show that images do not."""

    def test_one_part_in_ten_thousand_is_found_and_a_right_shader_passes(self, rng: np.random.Generator) -> None:
        for partings in (0.0, 3.0, 50.0):
            test, reference = pair(rng, partings)
            assert paired_verdict(test, reference).outcome == "pass"
            wrong = with_gain(test, 1e-4)
            assert paired_verdict(wrong, reference).mean.outcome == "fail"
            plain = bias_verdict(wrong, dataclasses.replace(reference, means=reference.means[::-1]))
            assert plain.mean.outcome != "fail"

    def test_a_defect_in_one_tile_is_placed(self, rng: np.random.Generator) -> None:
        test, reference = pair(rng, 3.0)
        found = paired_verdict(with_gain(test, 0.01, (30, 12, 6)), reference)
        assert found.outcome == "fail" and found.mean.outcome == "fail"
        assert found.fine.worst in {(row, column) for row in (10, 11) for column in (4, 5)}

    def test_noise_that_both_share_cancels_to_the_last_digit(self, rng: np.random.Generator) -> None:
        """The error is a ratio: T = 1.001 R in every batch has no noise, however noisy R is."""
        _, reference = pair(rng, 0.0)
        test = dataclasses.replace(reference, means=1.001 * reference.means)
        found = paired_verdict(test, reference, Tolerance(0.000999, 0.002, 0.002))
        assert found.mean.outcome == "fail"
        np.testing.assert_allclose(found.fine.error, 0.001, rtol=1e-9)
        np.testing.assert_allclose(found.mean.smallest_detectable, 2e-6, atol=2e-6)
        assert paired_verdict(test, reference, Tolerance(0.00101, 0.0102, 0.1)).mean.outcome == "pass"

    def test_values_that_are_not_finite_fail(self, rng: np.random.Generator) -> None:
        test, reference = pair(rng, 1.0)
        broken = test.means.copy()
        broken[3, 2, 1, 0] = np.nan
        found = paired_verdict(dataclasses.replace(test, means=broken), reference)
        assert found.outcome == "fail" and "not finite" in found.reason


class TestRates:
    """As measured at length by `harness calibrate`: here a little of it."""

    @pytest.mark.parametrize(("kind", "expected"), [("even", 0.3), ("even", 10.0), ("lamps", 3.0)])
    def test_false_alarms_are_no_more_frequent_than_stated(self, rng: np.random.Generator, kind: str,
                                                           expected: float) -> None:
        pairs = (pair(rng, expected, kind) for _ in range(25))
        for each in false_alarms("case", pairs, LOOKS, coupled()):
            assert each.judgement != "excessive", f"{each.subject}: {each.hits} of {each.trials} at {each.level}"

    def test_would_be_found_excessive(self, rng: np.random.Generator) -> None:
        pairs = [(with_gain(test, 1e-5), reference) for test, reference in (pair(rng, 3.0) for _ in range(10))]
        counted = {(each.subject, each.level): each for each in false_alarms("case", pairs, LOOKS, coupled())}
        assert counted["image", 0.01].hits > 5 and counted["image", 0.05].judgement == "excessive"

    def test_a_drift_that_partings_make_up_for_is_no_bias(self, rng: np.random.Generator) -> None:
        """All samples of a silhouette's tiles are off by 1.5 tolerances, and four partings a tile make up for it."""
        plan = Plan(side=60, batches=16, spp=64)
        unit = bias(PARTINGS["bright"], plan, 1.0)[1].max()
        expected = 1.5 * TIGHT.fine / unit
        drift = -bias(PARTINGS["bright"], plan, expected)[1]
        outcomes = [paired_verdict(*pair(rng, expected, "bright", plan, drift), TIGHT).outcome for _ in range(20)]
        assert outcomes.count("fail") == outcomes.count("pass") == 0

    def test_power(self, rng: np.random.Generator) -> None:
        plan = PairedLooking(LOOKS)
        found = coupled_power("case", [pair(rng, 3.0) for _ in range(4)], plan, rng)
        by = {(each.where, each.gain): each for each in found}
        assert by["everywhere", 0.0].passed == 4
        assert by["everywhere", 0.9 * COUPLED.mean].failed == 0
        assert by["everywhere", 2 * COUPLED.mean].failed == 4
        assert by["patch", COUPLED.fine].passed == 0 and by["patch", 4 * COUPLED.fine].failed == 4
        assert len([each for each in found if each.where == "everywhere"]) == len(COUPLED_GAINS)


class TestLargest:
    """What one sample may be at the most."""

    def test_is_a_tiles_own_or_the_parting_that_it_showed(self) -> None:
        means = np.ones((4, 1, 2, 4))
        largest = np.broadcast_to(np.array([0.5, 2.0])[None, None, :, None], means.shape)
        reference = TileSamples(means, np.full(4, 8.0), 2, 2, 4, largest)
        test = dataclasses.replace(reference, brightest=None)
        np.testing.assert_array_equal(largest_samples(test, reference)[0, :, 0], [0.5, 2.0])
        # A parting of 3.2: a tenth in one batch of 4 pixels of 8 samples.
        parted = means.copy()
        parted[1, 0, 1] += 0.1
        test = dataclasses.replace(reference, means=parted)
        np.testing.assert_allclose(largest_samples(test, reference)[0, :, 0], [0.5, 3.2])

    def test_a_lamp_in_one_tile_does_not_blind_another(self, rng: np.random.Generator) -> None:
        """What a tile may hide is told by its own light; that of the image by the brightest of all."""
        test, reference = pair(rng, 0.0)
        assert reference.brightest is not None
        lamp = reference.brightest.copy()
        lamp[3, 2, 5] = 1000.0
        plain, lit = (list(paired(test, dataclasses.replace(reference, brightest=each)))
                      for each in (reference.brightest, lamp))
        grown = [other.single > 1.001 * one.single for one, other in zip(plain, lit, strict=True)]
        assert [int(each[..., 3].sum()) for each in grown] == [1, 1, 1]
        assert grown[2][2, 5, 3] and grown[1][0, 1, 3]

    def test_is_kept_by_what_collects_batches(self) -> None:
        """The largest sum of a pixel's samples, or the largest sample where that is known, through tiles of every size,
        looks, and batches that are merged."""
        collected, exact = TileAccumulator(2), TileAccumulator(2)
        for k in range(4):
            image = np.ones((4, 8, 4))
            image[1, 5] = 3.0 + k
            collected.add(image, 16)
            exact.add(np.ones((4, 8, 4)), 16, image)
        samples, known = collected.samples(), exact.samples()
        assert samples.brightest is not None and known.brightest is not None
        np.testing.assert_array_equal(samples.brightest[:, :, :, 0].max(axis=1),
                                      [[16.0, 16.0, 16.0 * (3 + k), 16.0] for k in range(4)])
        np.testing.assert_array_equal(16 * known.brightest, samples.brightest)
        whole, first = samples.whole().brightest, samples.first(2).brightest
        assert whole is not None and first is not None
        assert whole.max() == 96.0 and first.max() == 64.0

    def test_unknown_is_refused(self, rng: np.random.Generator) -> None:
        test, reference = (dataclasses.replace(side, brightest=None) for side in pair(rng, 0.0))
        with pytest.raises(HarnessError, match="largest sample of the reference is not known"):
            paired_verdict(test, reference)


class TestPlan:
    """Looks, and budgets."""

    def test_the_outcome_alone_is_the_verdicts(self, rng: np.random.Generator) -> None:
        plan = PairedLooking(LOOKS)
        outcomes = set()
        for gain in (0.0, 2e-5, 1e-3):
            test, reference = pair(rng, 3.0, "lamps")
            for look, batches in enumerate((8, 16, 32)):
                sides = with_gain(test, gain).first(batches), reference.first(batches)
                verdict = plan.decide(look, *sides)
                assert plan.outcome(look, *sides) == verdict.outcome
                assert verdict.fine.pass_level == pytest.approx(0.05 * (0.5 if look == 2 else 0.25))
                outcomes.add(verdict.outcome)
        assert outcomes >= {"fail", "inconclusive"}

    def test_a_budget_that_the_rule_of_three_alone_exhausts_is_too_small(self, rng: np.random.Generator) -> None:
        """Samples are up to twice their mean: 3.7 M/n of a tile of 3 x 3 pixels at every look."""
        first = tuple(side.first(8) for side in pair(rng, 0.0))
        assert PairedLooking(LOOKS).too_small(0, *first) is None
        factor = PairedLooking(LOOKS, Tolerance(1e-5, 1e-4, 4e-4)).too_small(0, *first)
        assert factor == pytest.approx(-np.log(0.025) * 2 / (9 * 2048) / 4e-4, rel=0.05)

    def test_samples_needed_decide(self, rng: np.random.Generator) -> None:
        """So many times the samples of a first look pass, and half of them do not."""
        plan = PairedLooking(Looks((2048,)), TIGHT)
        test, reference = pair(rng, 0.0)
        factor = plan.factor_needed(test.first(8), reference.first(8))
        assert 1 < factor < 4
        enough, few = int(np.ceil(8 * factor)), int(8 * factor / 2)
        assert plan.outcome(0, test.first(enough), reference.first(enough)) == "pass"
        assert plan.outcome(0, test.first(few), reference.first(few)) == "inconclusive"

    @pytest.mark.parametrize("tolerance", [Tolerance(1e-7, 1e-4, 1e-3), Tolerance(1e-5, 0.0, 1e-3),
                                           Tolerance(1e-5, 1e-4, float("nan"))])
    def test_tolerances_that_float32_does_not_keep_are_refused(self, tolerance: Tolerance) -> None:
        with pytest.raises(HarnessError, match=f"below {FLOAT32_FLOOR:g}.*set it to that or more"):
            PairedLooking(LOOKS, tolerance)

    def test_what_does_not_go_in_pairs_is_refused(self, rng: np.random.Generator) -> None:
        test, reference = pair(rng, 0.0)
        other = dataclasses.replace(reference, samples=reference.samples * 2)
        for theirs in (reference.first(31), other, TileSamples.exact(np.ones((60, 60, 4)), PLAN.tile)):
            with pytest.raises(HarnessError, match="go in pairs"):
                paired_verdict(test, theirs)


class TestPartings:
    """The made-up pairs have the bias that they claim."""

    @pytest.mark.parametrize("kind", PARTINGS)
    def test_mean_and_number(self, rng: np.random.Generator, kind: str) -> None:
        parting: Parting = PARTINGS[kind]
        jumps = parting.jumps(rng, 20_000)
        assert np.abs(jumps).max() <= parting.largest
        assert abs(jumps.mean() - parting.mean) <= 4 * jumps.std() / np.sqrt(jumps.size)
        expected = 2000.0
        test, reference = pair(rng, expected, kind)
        truth, _ = bias(parting, PLAN, expected)
        away = (test.whole().means - reference.whole().means)[..., Channel.LUMINANCE]
        scale = reference.whole().means[..., Channel.LUMINANCE].mean()
        assert abs(away.mean() / scale - truth) < 4 * away.std() / scale / np.sqrt(away.size) + 1e-12
