"""The numbers that the abstract and the French page tell: by topic, each topic only where it was measured.

A topic is a group of numbers in print, by the names of the gaps in abstract.toml; a sentence is shown where its topic
is there. So what was not measured is not told, and both languages tell the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from harness.report import formats
from harness.report.inputs import Inputs
from harness.report.tables import EXPECTED_SLOPE, SLOPE_TOLERANCE, error_text, slope_mark
from harness.results import StrategyResult, StudyResult
from harness.stats.channels import Channel
from harness.stats.verdicts import TESTS
from harness.studies import EVEN
from harness.studies.equal_error import equal_error

Pair = tuple[StudyResult, StrategyResult]
Numbers = dict[str, str]
Topic = tuple[str, Numbers]

# Ideas that save samples: by which strategy over which other; names of samplers stand behind those of strategies.
IDEAS = (("importance", "mixture", "uniform"), ("lights", "mis", "mixture"),
         ("even", f"mis {EVEN}", "mis"), ("even", f"mixture {EVEN}", "mixture"))


def headline(inputs: Inputs) -> dict[str, Numbers]:
    """All topics that the inputs have something for."""
    return {name: numbers for topics in _TOPICS for name, numbers in topics(inputs)}


def judged_pairs(results: Sequence[StudyResult]) -> list[Pair]:
    """Every pair of scene and strategy that suits it."""
    return [(result, strategy) for result in results for strategy in result.strategies if strategy.suits]


def false_alarms(judged: Sequence[Pair]) -> float:
    """The probability with which any test of these pairs would fail, were every render right, at the most."""
    level = max((strategy.tiles.fine.fail_level for _, strategy in judged), default=0.0)
    return float(-np.expm1(TESTS * len(judged) * np.log1p(-level)))


def saved(results: Sequence[StudyResult]) -> dict[str, list[tuple[float, str]]]:
    """For each of `IDEAS` how many times sooner the same error is reached, and on which scene."""
    factors: dict[str, list[tuple[float, str]]] = {idea: [] for idea, *_ in IDEAS}
    for result in results:
        equal = equal_error(result)
        seconds = {cost.strategy.strategy: cost.seconds.value for cost in equal.costs} if equal else {}
        for idea, better, plain in IDEAS:
            if better in seconds and plain in seconds and np.isfinite(seconds[plain] / seconds[better]):
                factors[idea].append((seconds[plain] / seconds[better], result.scene))
    return factors


def _studied(inputs: Inputs) -> Iterator[Topic]:
    judged = judged_pairs(inputs.results)
    paths = sum(strategy.estimate.samples * strategy.estimate.mean[..., 0].size for _, strategy in judged)
    yield "studied", {"scenes": formats.count(len(inputs.results)), "pairs": formats.count(len(judged)),
                      "strategies": formats.count(len({strategy.strategy for _, strategy in judged})),
                      "paths": formats.count(paths / 1e6)}


def _agreement(inputs: Inputs) -> Iterator[Topic]:
    judged = judged_pairs(inputs.results)
    if not judged:
        return
    outcomes = [strategy.outcome for _, strategy in judged]
    passed, failed = outcomes.count("pass"), outcomes.count("fail")
    numbers = {
        "pairs": formats.count(len(judged)), "passed": formats.count(passed), "failed": formats.count(failed),
        "undecided": formats.count(len(judged) - passed - failed),
        "tolerance": " … ".join(map(formats.tolerance, sorted({s.verdict.tolerance for _, s in judged}))),
        "confidence": formats.share(min(strategy.verdict.confidence for _, strategy in judged)),
        "rate": formats.percent(false_alarms(judged), decimals=1)}
    yield ("right" if passed == len(judged) else "wrong" if failed else "open"), numbers
    known = [pair for pair in judged if np.isfinite(pair[1].verdict.error[Channel.LUMINANCE])]
    if known:
        result, worst = max(known, key=lambda pair: abs(float(pair[1].verdict.error[Channel.LUMINANCE])))
        yield "worst", {"error": error_text(worst, Channel.LUMINANCE), "scene": result.scene,
                        "strategy": worst.strategy}
    detectable = [float(np.max(strategy.verdict.smallest_detectable)) for _, strategy in judged]
    if np.isfinite(detectable).all():
        yield "sharp", {"bias": formats.percent(max(detectable)),
                        "median": formats.percent(float(np.median(detectable)))}


def _convergence(inputs: Inputs) -> Iterator[Topic]:
    fitted = [strategy for _, strategy in judged_pairs(inputs.results)
              if strategy.slope and np.isfinite(strategy.slope.slope)]
    if fitted:
        marks = [slope_mark(strategy) for strategy in fitted]
        yield "slopes", {"fitted": formats.count(len(fitted)), "shown": formats.count(marks.count("pass")),
                         "off": formats.count(marks.count("fail")), "slope": formats.number(EXPECTED_SLOPE, 1),
                         "within": formats.number(SLOPE_TOLERANCE, 2)}


def _savings(inputs: Inputs) -> Iterator[Topic]:
    for idea, found in saved(inputs.results).items():
        if found:
            least, most = min(found), max(found)
            yield idea, {"middle": formats.significant(float(np.median([factor for factor, _ in found])), 2),
                         "least": formats.significant(least[0], 2), "most": formats.significant(most[0], 2),
                         "worst": least[1], "best": most[1], "scenes": formats.plural(len(found), "scene")}


def _microscope(inputs: Inputs) -> Iterator[Topic]:
    ratios = [record.ratio for record in inputs.coupled if np.isfinite(record.ratio)]
    if ratios:
        largest = max(inputs.coupled, key=lambda record: abs(record.error[0]))
        yield "coupled", {"pairs": formats.count(len(inputs.coupled)),
                          "least": formats.significant(min(ratios), 2), "most": formats.significant(max(ratios), 2),
                          "middle": formats.significant(float(np.median(ratios)), 2),
                          "error": formats.significant(1e6 * abs(largest.error[0]), 2), "scene": largest.scene}


def _instrument(inputs: Inputs) -> Iterator[Topic]:
    """What is known of the verdicts themselves."""
    if inputs.calibration is not None:
        suite = inputs.calibration.suite
        yield "calibrated", {"runs": formats.count(suite.runs), "failed": formats.count(suite.failed),
                             "gates": formats.count(len(suite.gates))}
    if inputs.mutants is not None:
        total = len(inputs.mutants.mutants)
        yield "mutants", {"total": formats.count(total), "killed": formats.count(total - len(inputs.mutants.survivors))}
    if inputs.autopsies is not None and inputs.autopsies.reached:
        yield "autopsies", {"reached": formats.count(inputs.autopsies.reached),
                            "named": formats.count(inputs.autopsies.count("named"))}
    visible = sum(each.visible for each in inputs.causes.records) if inputs.causes else 0
    if inputs.causes and visible:
        first = sum(each.first for each in inputs.causes.records)
        yield "causes", {"visible": formats.count(visible), "first": formats.percent(first / visible, decimals=0)}
    if inputs.exhibits:
        yield "exhibits", {"errors": formats.count(len(inputs.exhibits))}


def _speed(inputs: Inputs) -> Iterator[Topic]:
    rows = [row.ratio for row in inputs.bench.rows if row.opponent == "path"] if inputs.bench else []
    if rows:
        yield "speed", {"least": formats.significant(min(rows), 2), "most": formats.significant(max(rows), 2)}
    best = [row.ratio for row in inputs.bench.entrants if row.best and row.renderer == "tracer"] if inputs.bench else []
    if best:
        yield "sooner", {"least": formats.significant(min(best), 2), "most": formats.significant(max(best), 2)}


_TOPICS: tuple[Callable[[Inputs], Iterator[Topic]], ...] = (
    _studied, _agreement, _convergence, _savings, _microscope, _instrument, _speed)
