"""The first page after the abstract: a summary computed from the data, and every verdict in one table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from harness.report import formats
from harness.report.blocks import Block, Chapter, Mark, Pointer, Remark, Remarks
from harness.report.chapters import exhibits
from harness.report.headline import judged_pairs, saved
from harness.report.inputs import Inputs
from harness.report.tables import (
    EXPECTED_SLOPE,
    SLOPE_TOLERANCE,
    error_text,
    is_exact,
    slope_mark,
    verdict_table,
)
from harness.report.tiles import tiles_summary
from harness.results import StrategyResult, StudyResult
from harness.stats.bias import POWER
from harness.stats.channels import Channel
from harness.studies.equal_error import Cost, equal_error

Pair = tuple[StudyResult, StrategyResult]

PLACE = 0
TITLE, ANCHOR = "Verdicts", "verdicts"

# So many pairs are named in a sentence of the summary; the verdict table names them all.
_MAX_NAMED = 4


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, on the abstract's page."""
    blocks: list[Block] = [Remarks(summary(inputs.results)), verdict_table(inputs.results, inputs.anchors)]
    if inputs.exhibits:
        blocks.append(Pointer(f"{exhibits.TITLE}, what each does to a picture and what finds it", exhibits.ANCHOR))
    yield Chapter(TITLE, ANCHOR, tuple(blocks), follows_on=True)


def summary(results: Sequence[StudyResult]) -> tuple[Remark, ...]:
    """What the data say, in sentences: agreement, how sharp the test was, convergence, gains, and what was left out."""
    pairs = [(result, strategy) for result in results for strategy in result.strategies]
    judged = judged_pairs(results)
    failed = [pair for pair in judged if pair[1].tiles.failed]
    remarks = [*_agreement(judged, len(results)), *tiles_summary(judged, _names(failed), failed),
               *_sharpness(judged), *_convergence(judged), *_bought(results), *_gains(results)]
    exact = [pair for pair in judged if is_exact(pair[1])]
    if exact:
        remarks.append(Remark(f"Exact, with no noise to converge: {_names(exact)}.", "exact"))
    unsuited = [pair for pair in pairs if not pair[1].suits]
    if unsuited:
        remarks.append(Remark(f"Not judged: {formats.plural(len(unsuited), 'pair')} whose strategy does not suit the "
                              f"scene ({_names(unsuited)}); the scene's pages say why.", "warning"))
    rejected = sum(strategy.estimate.rejected for _, strategy in pairs) + sum(r.reference.rejected for r in results)
    if rejected:
        remarks.append(Remark(f"{formats.plural(rejected, 'sample')} were not finite and were left out.", "warning"))
    return tuple(remarks)


def _agreement(judged: Sequence[Pair], scenes: int) -> list[Remark]:
    """How many pairs pass, fail, and are undecided, and the largest mean error among them."""
    if not judged:
        return []
    by_outcome: dict[Mark, list[Pair]] = {"pass": [], "fail": [], "inconclusive": []}
    for pair in judged:
        by_outcome[pair[1].verdict.outcome].append(pair)
    passed, failed, open_ = by_outcome["pass"], by_outcome["fail"], by_outcome["inconclusive"]
    tolerances = formats.words([formats.tolerance(t) for t in sorted({s.verdict.tolerance for _, s in judged})])
    of = f"{formats.plural(len(judged), 'pair')} of strategy and scene over {formats.plural(scenes, 'scene')}"
    remarks = []
    if failed:
        remarks.append(Remark(f"{len(failed)} of {of} differ from the reference in the mean by more than {tolerances}: "
                              f"{_names(failed)}.", "fail"))
    if open_:
        remarks.append(Remark(f"{len(open_)} of {of} are undecided in the mean at this number of samples: "
                              f"{_names(open_)}.", "inconclusive"))
    if passed:
        whole = "All" if len(passed) == len(judged) else f"{len(passed)} of"
        remarks.append(Remark(f"{whole} {of} agree with the reference within {tolerances} in the mean of every colour "
                              "channel.", "pass"))
    known = [pair for pair in judged if np.isfinite(pair[1].verdict.error[Channel.LUMINANCE])]
    if known:
        result, worst = max(known, key=lambda pair: abs(float(pair[1].verdict.error[Channel.LUMINANCE])))
        remarks.append(Remark(f"The largest mean error of luminance is {error_text(worst, Channel.LUMINANCE)} "
                              f"({result.scene}, {worst.strategy})."))
    return remarks


def _sharpness(judged: Sequence[Pair]) -> list[Remark]:
    """What bias could have hidden: a verdict is worth no more than the smallest bias that it would have found."""
    detectable = [(float(np.max(s.verdict.smallest_detectable)), r.scene, s.strategy) for r, s in judged]
    blind = [pair for pair, (size, *_) in zip(judged, detectable, strict=True) if not np.isfinite(size)]
    remarks = []
    if blind:
        remarks.append(Remark(f"Nothing bounds the bias of {formats.plural(len(blind), 'pair')} whose variance is "
                              f"unknown: {_names(blind)}.", "inconclusive"))
    if len(blind) < len(judged):
        size, scene, strategy = max(each for each in detectable if np.isfinite(each[0]))
        elsewhere = "everywhere else" if not blind else "wherever else the variance is known"
        remarks.append(Remark(
            f"Where the test is least sharp ({scene}, {strategy}) these samples would have revealed a bias of "
            f"{formats.percent(size)} with {formats.share(POWER)} probability, and smaller ones {elsewhere}."))
    return remarks


def _convergence(judged: Sequence[Pair]) -> list[Remark]:
    """The range of slopes and how many are what Monte Carlo promises."""
    fitted = [(pair, slope) for pair in judged if (slope := pair[1].slope) and np.isfinite(slope.slope)]
    if not fitted:
        return []
    slopes = [slope.slope for _, slope in fitted]
    marks = [slope_mark(pair[1]) for pair, _ in fitted]
    passed = marks.count("pass")
    around = sum(slope.low <= EXPECTED_SLOPE <= slope.high and np.isfinite(slope.low) for _, slope in fitted)
    spread = f", from {formats.number(min(slopes), 3)} to {formats.number(max(slopes), 3)}"
    mark: Mark = "fail" if "fail" in marks else "pass" if passed == len(marks) else "inconclusive"
    text = (f"RMSE falls with samples as Monte Carlo promises (slope {formats.fraction(EXPECTED_SLOPE)} ± "
            f"{formats.number(SLOPE_TOLERANCE, 2)}) for {passed} of {formats.plural(len(fitted), 'fitted slope')}"
            f"{spread}; the intervals of {around} contain {formats.fraction(EXPECTED_SLOPE)}.")
    for each, word in (("fail", "Not so"), ("inconclusive", "Not shown")):
        named = [pair for (pair, _), found in zip(fitted, marks, strict=True) if found == each]
        text += f" {word}: {_names(named)}." if named else ""
    return [Remark(text, mark)]


_IDEAS = {"importance": "importance sampling", "lights": "light sampling", "even": "evenly spread numbers"}


def _bought(results: Sequence[StudyResult]) -> list[Remark]:
    """How much sooner the same error is reached by each of three ideas: the middle of the scenes, and the extremes."""
    told = []
    for idea, found in saved(results).items():
        if not found:
            continue
        least, most = min(found), max(found)
        middle = formats.significant(float(np.median([factor for factor, _ in found])), 2)
        spread = (f"the middle of {formats.plural(len(found), 'scene')}, from {formats.significant(least[0], 2)} on "
                  f"{least[1]} to {formats.significant(most[0], 2)} on {most[1]}")
        told.append(f"{_IDEAS[idea]} {middle} times ({spread if len(found) > 1 else least[1]})")
    if not told:
        return []
    return [Remark(f"By how much sooner the same error is reached: {formats.words(told)}.")]


def _gains(results: Sequence[StudyResult]) -> list[Remark]:
    """The best and the worst that any strategy did against the baseline, samples and time."""
    gains: list[tuple[float, str, str, Cost]] = []
    for result in results:
        equal = equal_error(result)
        for cost in equal.costs if equal else ():
            if equal and cost.time_gain and cost.sample_gain and np.isfinite(cost.time_gain.value):
                gains.append((cost.time_gain.value, result.scene, equal.baseline, cost))
    if not gains:
        return []
    best, worst = max(gains, key=lambda gain: gain[0]), min(gains, key=lambda gain: gain[0])
    remarks = [Remark(f"At equal error the largest gain is {_gain(*best[1:])}.")]
    if worst[0] < 1:
        remarks.append(Remark(f"The largest loss is {_gain(*worst[1:])}."))
    return remarks


def _gain(scene: str, baseline: str, cost: Cost) -> str:
    assert cost.sample_gain is not None and cost.time_gain is not None
    samples, time = cost.sample_gain, cost.time_gain
    return (f"that of {cost.strategy.strategy} over {baseline} on {scene}: samples "
            f"{formats.ratio(samples.value, samples.low, samples.high)}, time "
            f"{formats.ratio(time.value, time.low, time.high)}")


def _names(pairs: Sequence[Pair]) -> str:
    named = [f"{result.scene} with {strategy.strategy}" for result, strategy in pairs[:_MAX_NAMED]]
    rest = len(pairs) - len(named)
    return formats.words([*named, formats.plural(rest, "other")] if rest else named)
