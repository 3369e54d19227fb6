"""The chapter on the method: estimator, material, densities, matching, verdicts. Words and formulas: method.toml."""

from __future__ import annotations

from collections.abc import Iterator

from harness.report import formats
from harness.report.blocks import Chapter
from harness.report.headline import false_alarms, judged_pairs
from harness.report.inputs import Inputs
from harness.report.texts import prose
from harness.stats.verdicts import TESTS

PLACE = 12
TITLE, ANCHOR = "Method", "method"


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, with the tolerances and rates of these verdicts."""
    verdicts = [strategy.verdict for result in inputs.results for strategy in result.strategies]
    judged = judged_pairs(inputs.results)
    values = {
        "confidence": formats.levels(verdict.confidence for verdict in verdicts),
        "tolerances": formats.words([formats.tolerance(each) for each in sorted({v.tolerance for v in verdicts})]),
        "tests": formats.count(TESTS), "judged": formats.count(len(judged)),
        "false_alarms": formats.percent(false_alarms(judged), decimals=1)}
    yield Chapter(TITLE, ANCHOR, tuple(prose("method.toml", values)))
