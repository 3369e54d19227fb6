"""The chapter on the last run of each gate: how many pass, and where the evidence of the others lies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import PurePosixPath

from harness.report import formats
from harness.report.blocks import Cell, Chapter, Column, Link, Mark, Paragraph, Remark, Remarks, Table
from harness.report.inputs import GATES_FOLDER, Inputs
from harness.results import GateEvidence

PLACE = 35
TITLE, ANCHOR = "The gates' last runs", "gate-runs"
# What a gate that did not pass is marked with, the worst first.
_MARKS: dict[str, Mark] = {"fail": "fail", "error": "fail", "inconclusive": "inconclusive"}


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, where gates left results beside the report."""
    if not inputs.gates:
        return
    lost = sorted((each for each in inputs.gates if each.record.outcome != "pass"),
                  key=lambda each: list(_MARKS).index(each.record.outcome))
    passed = len(inputs.gates) - len(lost)
    blocks = (Paragraph("A gate holds one scene and strategy to a tolerance in each run of the tests. Here is how each "
                        "gate ended when it ran last, which may be longer ago than this report."),
              Remarks((Remark(f"{passed} of {formats.plural(len(inputs.gates), 'gate')} passed.",
                              _MARKS[lost[0].record.outcome] if lost else "pass"),)))
    yield Chapter(TITLE, ANCHOR, (*blocks, _table(lost)) if lost else blocks)


def _table(lost: Sequence[GateEvidence]) -> Table:
    caption = (f"Gates that did not pass, and what they left in {GATES_FOLDER}/ beside this report: their images, maps "
               "and curves, and what runs them again.")
    columns = (Column("Gate"), Column("Outcome"), Column("Reason", share=2), Column("Evidence", share=1))
    return Table(caption, columns, tuple(_row(each) for each in lost), long=True)


def _row(each: GateEvidence) -> tuple[Cell, ...]:
    record, folder = each.record, f"{GATES_FOLDER}/{each.folder}"
    twice = [PurePosixPath(name).stem for name in each.files]
    links = tuple(Link(name if twice.count(stem := PurePosixPath(name).stem) > 1 else stem, f"{folder}/{name}")
                  for name in each.files)
    again = f" Again: {record.command}" if record.command else ""
    return (Cell(record.gate), Cell(record.outcome, _MARKS[record.outcome]),
            Cell(formats.sentence(formats.typographic(record.reason)) + again),
            Cell(f"{folder}/", links=links))
