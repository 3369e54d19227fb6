"""The verdicts' own error rates, on estimators made up for it: the fast part of the calibration."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from harness.errors import HarnessError
from harness.stats.calibration import (
    LEVELS,
    NO_TOLERANCE,
    SUBJECTS,
    FalseAlarms,
    Pair,
    _alarms,
    false_alarms,
    power,
    together,
)
from harness.stats.levels import Looks
from harness.stats.rates import Rate
from harness.stats.sequential import Looking
from harness.stats.synthetic import NOISES, Plan, draw, with_gain
from harness.stats.tiles import TileSamples
from harness.stats.verdicts import TESTS, Tolerance

PLAN = Plan(side=60, batches=32, spp=4)
LOOKS = Looks((64, 128))
COMPARISONS = 40


def pairs(rng: np.random.Generator, ours: str, theirs: str, count: int, plan: Plan = PLAN) -> list[Pair]:
    return [(draw(NOISES[ours], plan, rng), draw(NOISES[theirs], plan, rng)) for _ in range(count)]


class TestFalseAlarms:
    """Never above the level asked for, whatever the tails."""

    @pytest.mark.parametrize(("ours", "theirs"), [("normal", "normal"), ("fireflies", "normal"),
                                                  ("fireflies", "fireflies"), ("lognormal", "normal")])
    def test_are_no_more_frequent_than_stated(self, rng: np.random.Generator, ours: str, theirs: str) -> None:
        """Against one firefly in four tiles and 2800 % brighter, plain Welch alarms in every comparison."""
        found = false_alarms("case", pairs(rng, ours, theirs, COMPARISONS), LOOKS)
        assert [(each.subject, each.level) for each in found] == [(s, level) for level in LEVELS for s in SUBJECTS]
        for each in found:
            assert each.trials == COMPARISONS
            assert each.judgement != "excessive", f"{each.subject}: {each.hits} of {each.trials} at {each.level}"

    def test_would_be_found_excessive(self, rng: np.random.Generator) -> None:
        """A pair that differs by 3 % alarms, at the first look already; so does a tile alone that does."""
        broken = [(with_gain(test, 0.03), reference) for test, reference in pairs(rng, "normal", "normal", 10)]
        counted = {(each.subject, each.level): each for each in false_alarms("case", broken, LOOKS)}
        assert counted["image", 0.01].hits == counted["verdict with looks", 0.05].hits == 10
        assert counted["image", 0.05].judgement == "excessive"
        local = [(with_gain(test, 0.9, (12, 12, 6)), reference)
                 for test, reference in pairs(rng, "normal", "normal", 10)]
        counted = {(each.subject, each.level): each for each in false_alarms("case", local, LOOKS)}
        assert counted["smaller tiles", 0.01].hits == 10 > counted["image", 0.01].hits

    def test_at_an_early_look_must_be_surer(self) -> None:
        """Of 5 % the first quarter of the samples may spend 1.25 %, a third of that in each of three tests."""
        p = np.full((3, 2, TESTS), 0.9)
        p[0, 0, 1], p[1, 0, 1], p[2, 1, 1] = 0.004, 0.005, 0.012
        *_, verdict, looks = _alarms(p, Looks((32, 128)), 0.05)
        assert looks.tolist() == [True, False, True]
        assert verdict.tolist() == [False, False, True]

    def test_of_several_cases_add_up(self) -> None:
        alarms = [FalseAlarms(case, subject, level, 1, 10) for case in "ab" for level in LEVELS for subject in SUBJECTS]
        assert together(alarms, "all") == [FalseAlarms("all", subject, level, 2, 20)
                                           for level in LEVELS for subject in SUBJECTS]


class TestPower:
    """What becomes of renders that are too bright."""

    def test_a_plan_passes_the_good_and_fails_the_bad(self, rng: np.random.Generator) -> None:
        """Standard errors: 0.24 % of the image, 4.7 % of a small tile. Three times the tolerance is found early."""
        plan = Looking(LOOKS, Tolerance(0.02, 0.08, 0.4))
        gains = power("case", pairs(rng, "normal", "normal", 4), plan, rng)
        by = {(each.where, each.gain): each for each in gains}
        assert all(each.trials == 4 and each.failed + each.passed <= 4 for each in gains)
        assert by["everywhere", 0.0].passed == 4 and by["everywhere", 0.0].failed == 0
        assert by["everywhere", 0.03].failed > 0 and by["everywhere", 0.03].passed == 0
        assert by["patch", 0.01].passed == 4
        assert by["patch", 0.5].passed == 0
        assert by["everywhere", 0.0].tolerance == 0.02 and by["patch", 0.5].tolerance == 0.4
        assert by["everywhere", 0.0].share <= 1.0

    def test_without_tolerance_nothing_passes(self, rng: np.random.Generator) -> None:
        found = power("case", pairs(rng, "normal", "normal", 3), Looking(Looks((128,)), NO_TOLERANCE), rng)
        assert not any(each.passed for each in found)
        assert all(each.share == 1.0 for each in found)


class TestRate:
    """Binomial intervals."""

    @pytest.mark.parametrize(("hits", "trials"), [(0, 300), (3, 300), (17, 40), (40, 40)])
    def test_interval_is_clopper_and_pearsons(self, hits: int, trials: int) -> None:
        low, high = stats.binomtest(hits, trials).proportion_ci(0.95, method="exact")
        assert Rate(hits, trials).interval() == pytest.approx((low, high))

    @pytest.mark.parametrize(("hits", "judgement"), [(0, "conservative"), (15, "nominal"), (30, "excessive")])
    def test_judgement_holds_the_level_against_the_interval(self, hits: int, judgement: str) -> None:
        assert FalseAlarms("case", "image", 0.05, hits, 300).judgement == judgement


class TestSynthetic:
    """The made-up estimators have the mean that they claim."""

    @pytest.mark.parametrize("noise", NOISES)
    def test_all_estimate_the_same_image(self, rng: np.random.Generator, noise: str) -> None:
        """Over 4 images, within four standard errors of the whole image's mean."""
        held = [draw(NOISES[noise], PLAN, rng).whole() for _ in range(4)]
        means = np.concatenate([samples.means[:, 0, 0, 0] for samples in held])
        truth = np.geomspace(0.2, 2.0, 20).mean()
        assert abs(means.mean() - truth) < 4 * means.std() / np.sqrt(means.size)

    def test_a_patch_brightens_what_it_covers(self) -> None:
        """Six pixels from the fifth on cover a third of one tile of three pixels, all of the next, two thirds more."""
        means = np.stack([np.ones((4, 5, 4)), 2 * np.ones((4, 5, 4))])
        samples = TileSamples(means, np.array([1, 1]), 3, 12, 14)
        ratio = with_gain(samples, 0.3, (5, 0, 6)).means / means
        expected = np.outer([0, 1 / 3, 1, 2 / 3], [1, 1, 0, 0, 0])
        np.testing.assert_allclose(ratio[0, ..., 0], 1 + 0.3 * expected)

    def test_tiles_without_noise_keep_their_value(self) -> None:
        means = np.ones((2, 1, 2, 4))
        means[1, 0, 1] = 3.0
        gained = with_gain(TileSamples(means, np.array([1, 1]), 3, 3, 6), 0.5).means
        np.testing.assert_allclose(gained[:, 0, :, 0], [[1.0, 1.5], [1.0, 4.5]])

    @pytest.mark.parametrize("side", [64, 50, 80 + 1])
    def test_sides_without_equal_tiles_are_refused(self, side: int) -> None:
        with pytest.raises(HarnessError, match=f"found {side}"):
            Plan(side=side)
