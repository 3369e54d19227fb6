"""The report's tables, from study results to cells of text."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.metrics import Metric, shown_in
from harness.report import formats
from harness.report.blocks import SYMBOLS, Cell, Column, Mark, Swatch, Table
from harness.report.figures.style import strategy_style
from harness.results import StrategyResult, StudyResult
from harness.stats.bias import POWER
from harness.stats.channels import CHANNELS, Channel
from harness.stats.convergence import slope_verdict
from harness.studies.equal_error import EqualError

# What is said of a slope; it is no verdict on a render, which passes, fails or is inconclusive.
SLOPE_WORDS: dict[Mark, str] = {"pass": "yes", "fail": "no", "inconclusive": "not shown", "exact": "exact",
                                "": "not fitted"}
# The Monte Carlo rate that slopes are held against, and by how much a slope's interval may stray from it.
EXPECTED_SLOPE = -0.5
SLOPE_TOLERANCE = 0.05
# Of samples that are spread evenly: what falls how.
EVEN_SLOPES = ", ".join(f"{formats.fraction(slope)} of {what}" for slope, what in (
    (-1.0, "smooth pixels"), (-0.75, "edges"), (EXPECTED_SLOPE, "what hangs on many numbers")))


def strategy_cell(strategy: StrategyResult) -> Cell:
    """The strategy's name beside the marker of its curves."""
    style = strategy_style(strategy.strategy)
    return Cell(strategy.strategy, swatch=Swatch(style.glyph, style.colour))


def is_exact(strategy: StrategyResult) -> bool:
    """True where there is no noise to fit a slope to; a run of fewer than three prefixes has noise but no slope."""
    return strategy.slope is None and strategy.spp.size >= 3


def slope_mark(strategy: StrategyResult) -> Mark:
    """Is the slope what the sampler promises, -1/2 of independent samples? pass: shown; fail: shown not to be; else
    inconclusive; `exact` without noise, empty if not fitted."""
    if strategy.slope is None:
        return "exact" if is_exact(strategy) else ""
    return slope_verdict(strategy.slope, strategy.expected, SLOPE_TOLERANCE)


def error_text(strategy: StrategyResult, channel: int, *, unit: bool = True) -> str:
    """Mean error of one channel with its interval, in percent."""
    verdict = strategy.verdict
    error, low, high = (float(bound[channel]) for bound in (verdict.error, verdict.low, verdict.high))
    return formats.percent_interval(error, low, high, unit=unit)


def slope_text(strategy: StrategyResult) -> str:
    """The fitted slope and its interval; words where there is none."""
    slope = strategy.slope
    if slope is None:
        return "no noise" if is_exact(strategy) else "too few prefixes"
    return formats.interval(slope.slope, slope.low, slope.high, 3)


def verdict_table(results: Sequence[StudyResult], anchors: Sequence[str]) -> Table:
    """Scene × strategy: mean error, verdicts on mean and tiles, slope; scenes lead to their `anchors`."""
    rows: list[tuple[Cell, ...]] = []
    rules: list[int] = []
    for result, anchor in zip(results, anchors, strict=True):
        rules.append(len(rows))
        for index, strategy in enumerate(result.strategies):
            first = (Cell(result.scene, rows=len(result.strategies), target=anchor),) if index == 0 else ()
            rows.append((*first, strategy_cell(strategy), Cell(formats.count(strategy.estimate.samples)),
                         Cell(error_text(strategy, Channel.LUMINANCE)), *_verdict_cells(strategy)))
    confidence = _confidence_text([strategy for result in results for strategy in result.strategies])
    caption = (
        f"Verdicts. Mean error: of luminance, over the whole image, relative to the reference, with its {confidence} "
        "confidence interval. Beside it, each with its tolerance, the verdicts on the mean, on every larger and on "
        f"every smaller tile, in all channels: {SYMBOLS['pass']} shown to lie within, {SYMBOLS['fail']} shown to lie "
        f"outside, {SYMBOLS['inconclusive']} undecided by these samples. Slope: of RMSE against samples per pixel on "
        f"log axes. The Monte Carlo rate is {formats.fraction(EXPECTED_SLOPE)}; yes: the slope's whole interval lies "
        f"within {formats.number(EXPECTED_SLOPE - SLOPE_TOLERANCE, 2)} … "
        f"{formats.number(EXPECTED_SLOPE + SLOPE_TOLERANCE, 2)}, no: it lies outside, not shown: it reaches "
        f"across.{_evenly_text(results)}")
    columns = (Column("Scene", share=1), Column("Strategy"), Column("Samples\nper pixel", "right"),
               Column("Mean error", "right"), Column("Mean"), Column("Larger\ntiles"), Column("Smaller\ntiles"),
               Column("Slope", "right"), Column(f"Slope\n{formats.fraction(EXPECTED_SLOPE)}?"))
    return Table(caption, columns, tuple(rows), tuple(rules), long=True)


def _evenly_text(results: Sequence[StudyResult]) -> str:
    """What is expected of samples that are spread evenly, where there are such."""
    steepest = min(min(strategy.expected) for result in results for strategy in result.strategies)
    if steepest >= EXPECTED_SLOPE:
        return ""
    return (f" Where samples are spread evenly ({EVEN_SLOPES}), yes: it lies between "
            f"{formats.number(steepest - SLOPE_TOLERANCE, 2)} and "
            f"{formats.number(EXPECTED_SLOPE + SLOPE_TOLERANCE, 2)}.")


def _verdict_cells(strategy: StrategyResult) -> tuple[Cell, ...]:
    if not strategy.suits:
        return (Cell("not suited", "warning"), Cell(formats.MISSING), Cell(formats.MISSING),
                Cell(slope_text(strategy)), Cell("not judged", "warning"))
    mark = slope_mark(strategy)
    verdicts = (Cell(formats.tolerance(found.tolerance), found.outcome)
                for found in (strategy.verdict, strategy.tiles.coarse, strategy.tiles.fine))
    return (*verdicts, Cell(slope_text(strategy)), Cell(SLOPE_WORDS[mark], mark))


def accuracy_table(result: StudyResult) -> Table:
    """Every channel's mean error, the bias that would have been found, and image metrics, one row a strategy."""
    scores = shown_in("report")
    rows = []
    for strategy in result.strategies:
        detectable = float(np.max(strategy.verdict.smallest_detectable))
        rows.append((
            strategy_cell(strategy), *(Cell(error_text(strategy, channel, unit=False)) for channel in Channel),
            Cell(formats.percent(detectable, unit=False)),
            *(Cell(_score_text(metric, strategy.score(metric.name))) for metric in scores),
            Cell(formats.count(strategy.estimate.rejected))))
    confidence = _confidence_text(result.strategies)
    caption = (
        f"How close each strategy comes, with all replicas merged. Mean errors in percent of the reference's mean, "
        f"with {confidence} intervals. Detectable: the smallest bias of any channel, in percent, that this many "
        f"samples would have found with {formats.share(POWER)} probability. {_score_words(scores)}"
        "Rejected: samples that were not finite.")
    columns = (Column("Strategy", share=1), *(Column(name.capitalize(), "right") for name in CHANNELS),
               Column("Detectable", "right"),
               *(Column(f"{metric.heading}\n({metric.unit})" if metric.unit else metric.heading, "right")
                 for metric in scores), Column("Rejected", "right"))
    return Table(caption, columns, tuple(rows))


def _score_text(metric: Metric, value: float) -> str:
    return formats.significant(value) if metric.decimals is None else formats.number(value, metric.decimals)


def _score_words(scores: Sequence[Metric]) -> str:
    """What each metric of the table is, those that have a curve first: they are told of one replica."""
    of_one = [metric.heading for metric in scores if metric.at_prefixes]
    words = f"{formats.words(of_one)}: of one replica at full length, the mean over replicas. " if of_one else ""
    return words + "".join(f"{metric.heading}: {metric.sentence}. " for metric in scores if not metric.at_prefixes)


def cost_table(result: StudyResult, equal: EqualError) -> Table:
    """What equal error costs: samples and time of each strategy, and how many times less than the baseline."""
    costs = {cost.strategy.strategy: cost for cost in equal.costs}
    rows: list[tuple[Cell, ...]] = []
    for strategy in result.strategies:
        head = (strategy_cell(strategy), Cell(formats.duration(strategy.seconds_per_spp)))
        cost = costs.get(strategy.strategy)
        if cost is None:
            word = "not suited" if not strategy.suits else "exact" if is_exact(strategy) else "not fitted"
            mark: Mark = "warning" if not strategy.suits else "exact" if is_exact(strategy) else ""
            rows.append((*head, Cell(word, mark, columns=5)))
            continue
        nothing = f"1{formats.TIMES}" if strategy.strategy == equal.baseline else formats.MISSING
        gains = [formats.ratio(gain.value, gain.low, gain.high) if gain else nothing
                 for gain in (cost.variance_ratio, cost.sample_gain, cost.time_gain)]
        needed = formats.NBSP.join(formats.spread(cost.spp.value, cost.spp.low, cost.spp.high))
        rows.append((*head, Cell(gains[0]), Cell(needed.rstrip(formats.NBSP)),
                     Cell(formats.duration(cost.seconds.value)), *(Cell(gain) for gain in gains[1:])))
    caption = (
        "What equal error costs: samples and time with which each strategy reaches an RMSE of "
        f"{formats.significant(equal.rmse)}, the largest that a suitable strategy still has at the end of its run; and "
        f"how many times less that is than {equal.baseline} needs (above one: cheaper). Beside it the ratio of the "
        "variances of one sample, measured at the end of the runs; fewer samples are that ratio where both converge "
        f"with slope {formats.fraction(EXPECTED_SLOPE)}; evenly spread samples have none of their own. Intervals over "
        f"replicas at {_slope_confidence(equal)} confidence, the replicas of two strategies taken as independent; the "
        "fitted power laws are solved for the error, and the time of one sample is taken as exact. Times are by the "
        "clock that counts on the device, the CPU's or the GPU's.")
    columns = (Column("Strategy", share=1), Column("Time of one\nsample/pixel", "right"),
               Column(f"Variance of\n{equal.baseline} / own", "right"), Column("Samples per pixel\nneeded", "right"),
               Column("Time\nneeded", "right"), Column(f"Fewer samples\nthan {equal.baseline}", "right"),
               Column(f"Less time\nthan {equal.baseline}", "right"))
    return Table(caption, columns, tuple(rows))


def _slope_confidence(equal: EqualError) -> str:
    return formats.levels(cost.strategy.slope.confidence for cost in equal.costs if cost.strategy.slope)


def _confidence_text(strategies: Sequence[StrategyResult]) -> str:
    return formats.levels(strategy.verdict.confidence for strategy in strategies)
