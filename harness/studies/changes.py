"""What changed between two stored studies: cell by cell, with intervals that allow for how many cells there are."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from harness.errors import HarnessError
from harness.policy import FALSE_ALARMS
from harness.results import StrategyResult, StudyResult
from harness.stats import changes as stats
from harness.stats.changes import Difference, Measured
from harness.stats.channels import CHANNELS
from harness.stats.levels import family_level
from harness.studies.product import StudyProduct

Quantity = Literal["mean error", "rmse", "slope", "seconds", "efficiency"]
Verdict = Literal["changed", "not distinguishable", "unknown", "only in A", "only in B"]
# Quantities of which a worse one makes a comparison fail. Seconds are of the moment, and so is what counts them: a
# machine that was busy is nobody's mistake.
DECIDING: tuple[Quantity, ...] = ("mean error", "rmse", "slope")
# Of these a difference is one of logarithms, told as the ratio B / A.
RATIOS: tuple[Quantity, ...] = ("rmse", "seconds", "efficiency")


@dataclass(frozen=True)
class Change:
    """One number of a cell: what it was in A and in B, and B - A, or B / A for `RATIOS`, with its interval.

    `channel`: of the mean error. `samples`: per pixel, where both are told. `changed`: None where it cannot be known;
    `worse`: where it changed to the worse.
    """

    quantity: Quantity
    channel: str
    samples: int
    a: float
    b: float
    difference: float
    low: float
    high: float
    changed: bool | None
    worse: bool


@dataclass(frozen=True)
class CellChange:
    """One estimator on one scene with one set of parameters. `a`, `b`: the outcomes of its verdicts, empty where it is
    not there; `notes`: what differs besides."""

    scene: str
    parameters: tuple[tuple[str, str], ...]
    estimator: str
    verdict: Verdict
    a: str
    b: str
    changes: tuple[Change, ...]
    notes: tuple[str, ...] = ()

    @property
    def worse(self) -> bool:
        """Whether a number that decides got significantly worse, or a verdict that did not fail fails now."""
        return any(change.worse and change.quantity in DECIDING for change in self.changes) or (
            self.b == "fail" and self.a not in ("fail", ""))


@dataclass(frozen=True)
class Changes:
    """All cells of both studies. `level`: of each single test, so that all together find a difference where there is
    none with probability `FALSE_ALARMS` at the most; `tests`: how many there are."""

    level: float
    tests: int
    cells: tuple[CellChange, ...]

    @property
    def worse(self) -> bool:
        """Whether some cell is."""
        return any(cell.worse for cell in self.cells)


@dataclass(frozen=True)
class _Pair:
    """What is compared in one quantity; measured values are logarithms where it is a ratio."""

    quantity: Quantity
    channel: str
    samples: int
    before: Measured
    after: Measured


def compare_products(before: StudyProduct, after: StudyProduct) -> Changes:
    """Cells matched by scene, parameters and estimator; each quantity with an interval at one simultaneous level.

    HarnessError where the two have no cell in common.
    """
    ours, theirs = _cells(before), _cells(after)
    common = [key for key in ours if key in theirs]
    if not common:
        raise HarnessError("the two studies have no cell in common (scene, parameters, estimator); in A: "
                           f"{_told(ours)}; in B: {_told(theirs)}")
    pairs = {key: list(_pairs(ours[key][1], theirs[key][1])) for key in common}
    tests = sum(map(len, pairs.values()))
    level = family_level(FALSE_ALARMS, max(tests, 1))
    cells = [_cell(key, ours[key], theirs[key], pairs[key], level) for key in common]
    cells += [_alone(key, ours[key][1], "only in A") for key in ours if key not in theirs]
    cells += [_alone(key, theirs[key][1], "only in B") for key in theirs if key not in ours]
    return Changes(level, tests, tuple(cells))


_Key = tuple[str, tuple[tuple[str, str], ...], str]


def _cells(product: StudyProduct) -> dict[_Key, tuple[StudyResult, StrategyResult]]:
    return {(*study.cell, item.strategy): (study, item) for study in product.studies for item in study.strategies}


def _told(cells: dict[_Key, tuple[StudyResult, StrategyResult]]) -> str:
    scene, parameters, estimator = next(iter(cells))
    more = f" and {len(cells) - 1} more" if len(cells) > 1 else ""
    return " ".join([scene, *(f"{name}={value}" for name, value in parameters), estimator]) + more


def _pairs(a: StrategyResult, b: StrategyResult) -> Iterator[_Pair]:
    for index, channel in enumerate(CHANNELS):
        yield _Pair("mean error", channel, 0, *(stats.from_interval(
            float(item.verdict.error[index]), float(item.verdict.low[index]), float(item.verdict.high[index]),
            item.verdict.confidence, float(item.verdict.dof[index])) for item in (a, b)))
    both = np.intersect1d(a.spp, b.spp)
    if both.size:
        last = int(both[-1])
        at = [int(np.flatnonzero(item.spp == last)[0]) for item in (a, b)]
        errors = [item.curves["rmse"][:, index] for item, index in zip((a, b), at, strict=True)]
        yield _Pair("rmse", "", last, *map(stats.log_error, errors))
        if a.device == b.device and a.device:
            yield _Pair("seconds", "", last, *(stats.log_seconds(item.replica_seconds) for item in (a, b)))
            yield _Pair("efficiency", "", last, *(
                stats.log_efficiency(last, error, item.replica_seconds)
                for item, error in zip((a, b), errors, strict=True)))
    if a.slope is not None and b.slope is not None:
        yield _Pair("slope", "", 0, *(stats.slope(item.spp, item.curves["rmse"]) for item in (a, b)))


def _cell(key: _Key, before: tuple[StudyResult, StrategyResult], after: tuple[StudyResult, StrategyResult],
          pairs: list[_Pair], level: float) -> CellChange:
    changes = tuple(_change(pair, level) for pair in pairs)
    known = [change.changed for change in changes if change.changed is not None]
    verdict: Verdict = "changed" if any(known) else "not distinguishable" if known else "unknown"
    (a_study, a), (b_study, b) = before, after
    if a.outcome != b.outcome and verdict != "changed" and "fail" in (a.outcome, b.outcome):
        verdict = "changed"  # a tile, which no number here is of
    notes = []
    if a_study.scene_hash != b_study.scene_hash:
        notes.append("the scene, its size or its depth differs")
    if a.device != b.device:
        notes.append(f"seconds have no ratio: '{a.device}' and '{b.device}'")
    return CellChange(*key, verdict, a.outcome, b.outcome, changes, tuple(notes))


def _change(pair: _Pair, level: float) -> Change:
    found = stats.difference(pair.before, pair.after, level)
    a, b = pair.before.value, pair.after.value
    worse = bool(found.changed) and _is_worse(pair.quantity, a, b)
    if pair.quantity in RATIOS:
        a, b = _exp(a), _exp(b)
        found = Difference(_exp(found.value), _exp(found.low), _exp(found.high))
        changed = None if math.isnan(found.low) else found.low > 1 or found.high < 1
    else:
        changed = found.changed
    return Change(pair.quantity, pair.channel, pair.samples, a, b, found.value, found.low, found.high, changed, worse)


def _is_worse(quantity: Quantity, a: float, b: float) -> bool:
    """Errors farther from zero, slopes that are flatter, more seconds, less efficiency."""
    if quantity == "mean error":
        return abs(b) > abs(a)
    return b < a if quantity == "efficiency" else b > a


def _alone(key: _Key, item: StrategyResult, verdict: Verdict) -> CellChange:
    here = item.outcome
    return CellChange(*key, verdict, here if verdict == "only in A" else "", here if verdict == "only in B" else "", ())


def _exp(value: float) -> float:
    return math.nan if math.isnan(value) else float(np.exp(min(value, 700.0)))
