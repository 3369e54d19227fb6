"""How often do the verdicts err? False alarms on pairs that estimate the same image, and power on pairs that do not."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from harness.stats.bias import Outcome
from harness.stats.levels import Looks, family_level
from harness.stats.paired import PairedLooking, paired
from harness.stats.rates import Rate, Where
from harness.stats.sequential import Looking
from harness.stats.suites import SuiteRates
from harness.stats.synthetic import with_gain
from harness.stats.tiles import PATCH, ImageMoments, TileSamples
from harness.stats.verdicts import TESTS, Tolerance, bias_p_values, contrast_p_values

# Test and reference of one comparison.
Pair = tuple[TileSamples, TileSamples]

# The rates that the tests are asked for when their false alarms are counted; the last is what a suite asks of a gate.
LEVELS = (0.05, 0.01, 0.001)
# Relative gains: of the whole image, and of a square of 1 % of it.
GLOBAL_GAINS = (0.0005, 0.001, 0.002, 0.003, 0.005, 0.01, 0.03)
PATCH_GAINS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
# The tests of a verdict, the verdict on all samples, and the one that looks as they grow.
SUBJECTS = ("image", "larger tiles", "smaller tiles", "verdict", "verdict with looks")
NO_TOLERANCE = Tolerance(0.0, 0.0, 0.0)
# Gains of coupled estimates, in tolerances: of the image's mean everywhere, of a smaller tile in a patch.
COUPLED_GAINS = (0.0, 0.9, 1.1, 1.5, 2.0)
COUPLED_PATCH_GAINS = (0.5, 1.0, 1.5, 2.0, 4.0)

# Of a pair as far as it was drawn: the p of the three tests of a verdict.
PValues = Callable[[TileSamples, TileSamples], tuple[float, float, float]]


@dataclass(frozen=True)
class FalseAlarms:
    """How often `subject` (one of `SUBJECTS`), asked for the rate `level` at the most, alarmed on pairs `case`."""

    case: str
    subject: str
    level: float
    hits: int
    trials: int

    @property
    def rate(self) -> Rate:
        """As measured."""
        return Rate(self.hits, self.trials)

    @property
    def judgement(self) -> Literal["nominal", "conservative", "excessive"]:
        """Does the 95 % interval of the rate hold the level, lie below it, or above?"""
        low, high = self.rate.interval()
        return "excessive" if low > self.level else "nominal" if high >= self.level else "conservative"


@dataclass(frozen=True)
class Power:
    """What became of pairs `case` whose test was brighter by `gain`, `where`, under a plan with some tolerance.

    Of `trials` pairs, `failed` and `passed`; the others were undecided. `share`: of the budget, on average, that was
    drawn until then.
    """

    case: str
    where: Where
    gain: float
    tolerance: float
    failed: int
    passed: int
    trials: int
    share: float


@dataclass(frozen=True)
class Calibration:
    """All that was measured. `cases`: name -> what the pairs are; `facts`: versions and settings, all strings.

    `alarms` and `powers` are of verdicts on pairs of estimates, `suite` of the gates of a file as they stand;
    `coupled`: what became of pairs that share their random numbers.
    """

    cases: dict[str, str]
    alarms: tuple[FalseAlarms, ...]
    powers: tuple[Power, ...]
    suite: SuiteRates
    facts: dict[str, str]
    coupled: tuple[Power, ...] = ()


def without_tolerance(test: TileSamples, reference: TileSamples) -> tuple[float, float, float]:
    """The p of estimates with random numbers of their own; the verdicts' own tolerances could only hide an error of the
    level."""
    return bias_p_values(ImageMoments.of(test), ImageMoments.of(reference), NO_TOLERANCE)


def coupled(tolerance: Tolerance = NO_TOLERANCE) -> PValues:
    """The p of estimates with the same random numbers."""
    return lambda test, reference: contrast_p_values(paired(test, reference), tolerance)


def false_alarms(case: str, pairs: Iterable[Pair], looks: Looks,
                 p_values: PValues = without_tolerance) -> list[FalseAlarms]:
    """Count false alarms over pairs that have the same mean; each pair's batches are equal and fill the looks' budget.
    """
    p = np.array([[p_values(_until(test, looks, look), _until(reference, looks, look))
                   for look in range(len(looks.samples))] for test, reference in pairs])
    return [FalseAlarms(case, subject, level, int(np.sum(alarm)), len(p))
            for level in LEVELS for subject, alarm in zip(SUBJECTS, _alarms(p, looks, level), strict=True)]


def by_case(alarms: Sequence[FalseAlarms]) -> dict[str, dict[float, list[FalseAlarms]]]:
    """Case -> level -> one a subject, for levels at which at least one alarm was to be expected."""
    cases: dict[str, dict[float, list[FalseAlarms]]] = {}
    for each in alarms:
        if each.level * each.trials >= 1:
            cases.setdefault(each.case, {}).setdefault(each.level, []).append(each)
    return cases


def together(alarms: Sequence[FalseAlarms], case: str) -> list[FalseAlarms]:
    """The counts of all cases as one case."""
    sums: dict[tuple[str, float], FalseAlarms] = {}
    for each in alarms:
        key = each.subject, each.level
        held = sums.get(key, FalseAlarms(case, *key, 0, 0))
        sums[key] = replace(held, hits=held.hits + each.hits, trials=held.trials + each.trials)
    return list(sums.values())


def power(case: str, pairs: Sequence[Pair], plan: Looking, rng: np.random.Generator) -> list[Power]:
    """What a plan makes of gains of every size, zero included: the same pairs for each, patches at random places."""
    side = int(np.sqrt(PATCH * pairs[0][0].height * pairs[0][0].width))
    patches = [(int(rng.integers(test.height - side + 1)), int(rng.integers(test.width - side + 1)), side)
               for test, _ in pairs]
    whole: list[tuple[int, int, int] | None] = [None] * len(pairs)

    references = [_at_looks(reference, plan.looks) for _, reference in pairs]

    def measured(where: Where, gain: float) -> Power:
        places, tolerance = (patches, plan.tolerance.fine) if where == "patch" else (whole, plan.tolerance.mean)
        ended = [_ended(plan, with_gain(test, gain, place), reference)
                 for (test, _), reference, place in zip(pairs, references, places, strict=True)]
        outcomes = [outcome for outcome, _ in ended]
        return Power(case, where, gain, tolerance, outcomes.count("fail"), outcomes.count("pass"), len(pairs),
                     float(np.mean([share for _, share in ended])))

    return [*(measured("everywhere", gain) for gain in (0.0, *GLOBAL_GAINS)),
            *(measured("patch", gain) for gain in PATCH_GAINS)]


def coupled_power(case: str, pairs: Sequence[Pair], plan: PairedLooking, rng: np.random.Generator) -> list[Power]:
    """What a plan makes of gains of coupled estimates: `COUPLED_GAINS` of everything, `COUPLED_PATCH_GAINS` at random
    places; both in tolerances, and so are the gains of the result in relative terms."""
    side = int(np.sqrt(PATCH * pairs[0][0].height * pairs[0][0].width))
    patches = [(int(rng.integers(test.height - side + 1)), int(rng.integers(test.width - side + 1)), side)
               for test, _ in pairs]
    whole: list[tuple[int, int, int] | None] = [None] * len(pairs)

    def measured(where: Where, gain: float) -> Power:
        places, tolerance = (patches, plan.tolerance.fine) if where == "patch" else (whole, plan.tolerance.mean)
        ended = [_ended_coupled(plan, with_gain(test, gain * tolerance, place), reference)
                 for (test, reference), place in zip(pairs, places, strict=True)]
        outcomes = [outcome for outcome, _ in ended]
        return Power(case, where, gain * tolerance, tolerance, outcomes.count("fail"), outcomes.count("pass"),
                     len(pairs), float(np.mean([share for _, share in ended])))

    return [*(measured("everywhere", gain) for gain in COUPLED_GAINS),
            *(measured("patch", gain) for gain in COUPLED_PATCH_GAINS)]


def _ended_coupled(plan: PairedLooking, test: TileSamples, reference: TileSamples) -> tuple[Outcome, float]:
    """As `_ended`."""
    return _first_decided(plan.looks, lambda look: plan.outcome(look, _until(test, plan.looks, look),
                                                                _until(reference, plan.looks, look)))


def _ended(plan: Looking, test: TileSamples, reference: Sequence[ImageMoments]) -> tuple[Outcome, float]:
    """The outcome of a sequence of looks, and the share of its budget at which it came."""
    return _first_decided(plan.looks, lambda look: plan.outcome(
        look, ImageMoments.of(_until(test, plan.looks, look)), reference[look]))


def _first_decided(looks: Looks, outcome_at: Callable[[int], Outcome]) -> tuple[Outcome, float]:
    """The first outcome that is decided, or the last, and the share of the budget."""
    budget = looks.samples[-1]
    for look, samples in enumerate(looks.samples):
        outcome = outcome_at(look)
        if outcome != "inconclusive" or samples == budget:
            return outcome, samples / budget
    raise AssertionError("the last look is at the budget")


def _at_looks(samples: TileSamples, looks: Looks) -> list[ImageMoments]:
    return [ImageMoments.of(_until(samples, looks, look)) for look in range(len(looks.samples))]


def _until(samples: TileSamples, looks: Looks, look: int) -> TileSamples:
    """The batches that have been drawn at a look."""
    return samples.first(round(len(samples.samples) * looks.samples[look] / looks.samples[-1]))


def _alarms(p: np.ndarray, looks: Looks, level: float) -> list[np.ndarray]:
    """Which pairs each subject alarms on, given p-values (pairs, looks, tests)."""
    each = [family_level(looks.level(look, level), TESTS) for look in range(len(looks.samples))]
    return [*(p[:, -1] < level).T, (p[:, -1] < family_level(level, TESTS)).any(axis=-1),
            (p < np.array(each)[:, None]).any(axis=(1, 2))]
