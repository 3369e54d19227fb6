"""The page on what the report cannot show: blind spots (limits.toml), and what was not measured for it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from harness.report import formats
from harness.report.blocks import Block, Chapter, Heading, Remark, Remarks
from harness.report.headline import false_alarms, judged_pairs
from harness.report.inputs import Inputs
from harness.report.texts import prose

PLACE = 65
TITLE, ANCHOR = "What this cannot show", "limits"

# What a report has where another command left it, by the name in `Inputs`; and the command.
_LEFT = (("coupled", "the same paths by Mitsuba", "harness report"),
         ("exhibits", "the handout's errors", "harness report, without scene files of your own"),
         ("calibration", "how often the verdicts err", "harness calibrate"),
         ("mutants", "which gates notice which seeded bugs", "harness mutants"),
         ("autopsies", "how often an autopsy names the right function", "harness mutants --autopsy"),
         ("oracle", "the coupled oracle against Mitsuba's path", "harness oracle"),
         ("causes", "how often the cause of a stranger's picture is named", "harness causes"),
         ("bench", "speed against Mitsuba", "harness bench"))


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The page, with what these verdicts could not have seen."""
    judged = judged_pairs(inputs.results)
    detectable = [float(np.max(strategy.verdict.smallest_detectable)) for _, strategy in judged]
    tolerances = sorted({strategy.verdict.tolerance for _, strategy in judged})
    devices = sorted({strategy.device for _, strategy in judged if strategy.device})
    values = {"sharp": formats.percent(min(detectable, default=np.nan)),
              "blunt": formats.percent(max(detectable, default=np.nan)),
              "tolerances": formats.words([formats.tolerance(each) for each in tolerances]),
              "devices": formats.words(devices) or "a device of which nothing is known",
              "rate": formats.percent(false_alarms(judged), decimals=1)}
    yield Chapter(TITLE, ANCHOR, (*prose("limits.toml", values), *_missing(inputs)))


def _missing(inputs: Inputs) -> tuple[Block, ...]:
    """What was not measured, each with the command that measures it."""
    remarks = tuple(Remark(f"{what[:1].upper()}{what[1:]}: {command}.") for name, what, command in _LEFT
                    if not getattr(inputs, name))
    return (Heading("Not measured for this report"), Remarks(remarks)) if remarks else ()
