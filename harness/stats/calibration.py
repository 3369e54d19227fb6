"""How often do the verdicts err? False alarms on pairs that estimate the same image, and power on pairs that do not."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from harness.stats.bias import Outcome
from harness.stats.levels import Looks, family_level
from harness.stats.rates import Rate, Where
from harness.stats.sequential import Looking
from harness.stats.suites import SuiteRates
from harness.stats.synthetic import with_gain
from harness.stats.tiles import PATCH, ImageMoments, TileSamples
from harness.stats.verdicts import TESTS, Tolerance, bias_p_values

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

    `alarms` and `powers` are of verdicts on pairs of estimates, `suite` of the gates of a file as they stand.
    """

    cases: dict[str, str]
    alarms: tuple[FalseAlarms, ...]
    powers: tuple[Power, ...]
    suite: SuiteRates
    facts: dict[str, str]


def false_alarms(case: str, pairs: Iterable[Pair], looks: Looks) -> list[FalseAlarms]:
    """Count false alarms over pairs that have the same mean; each pair's batches are equal and fill the looks' budget.

    Without tolerance: the verdicts' own tolerances could only hide an error of the level.
    """
    p = np.array([[bias_p_values(ours, theirs, NO_TOLERANCE) for ours, theirs in zip(
        _at_looks(test, looks), _at_looks(reference, looks), strict=True)] for test, reference in pairs])
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


def _ended(plan: Looking, test: TileSamples, reference: Sequence[ImageMoments]) -> tuple[Outcome, float]:
    """The outcome of a sequence of looks, and the share of its budget at which it came."""
    budget = plan.looks.samples[-1]
    for look, samples in enumerate(plan.looks.samples):
        outcome = plan.outcome(look, ImageMoments.of(_until(test, plan.looks, look)), reference[look])
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
