"""`harness compare-studies`: what changed between two stored studies, cell by cell."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.output import JsonOption, print_json, print_rich

if TYPE_CHECKING:
    from harness.studies.changes import CellChange, Change, Quantity


def compare_studies(
    before: Annotated[Path, typer.Argument(metavar="A", help="The folder of a study (`harness study -o`).",
                                           show_default=False)],
    after: Annotated[Path, typer.Argument(metavar="B", help="The folder of the one that is held against it.",
                                          show_default=False)],
    json: JsonOption = False,
) -> int:
    """Say what changed from one stored study to another: errors, slopes, seconds and efficiency of every cell that both
    have, by scene, parameters and estimator.

    Each difference has an interval; all of them share one rate of false alarms, 1 in 100, so that a cell counts as
    changed where an interval leaves zero out (or 1, of ratios). Exit status 1 when a mean error, an RMSE at equal
    samples or a slope got significantly worse, or a verdict fails that did not. Seconds are told and do not count:
    they are those of a machine at one moment.

    Example: `harness compare-studies before after`
    """
    from harness.studies.changes import compare_products
    from harness.studies.kept import load_studies

    changes = compare_products(load_studies(before), load_studies(after))
    if json:
        print_json({"a": before, "b": after, "level": changes.level, "tests": changes.tests, "worse": changes.worse,
                    "cells": [{"scene": cell.scene, "parameters": dict(cell.parameters), "estimator": cell.estimator,
                               "verdict": cell.verdict, "worse": cell.worse, "outcome": {"a": cell.a, "b": cell.b},
                               "changes": cell.changes, "notes": cell.notes} for cell in changes.cells]})
        return 1 if changes.worse else 0
    _print(changes.cells)
    print(f"{changes.tests} differences, each at the level {changes.level:.2g}: together they find one where there is "
          "none in 1 comparison of 100 at the most")
    return 1 if changes.worse else 0


def _print(cells: tuple[CellChange, ...]) -> None:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for heading in ("cell", "verdict", "mean error", "B - A", "RMSE B / A", "slope B - A", "seconds B / A",
                    "efficiency B / A"):
        table.add_column(heading, justify="left" if heading in ("cell", "verdict") else "right")
    for cell in cells:
        mean = _worst(cell)
        table.add_row(_name(cell), cell.verdict + (", worse" if cell.worse else ""),
                      f"{mean.a:+.3%} to {mean.b:+.3%}" if mean else "", _difference(mean, percent=True),
                      *(_difference(_of(cell, quantity)) for quantity in ("rmse", "slope", "seconds", "efficiency")))
    print_rich(table)
    for cell in cells:
        for told in _told(cell):
            print(f"{_name(cell)}: {told}")
    counts = Counter(cell.verdict for cell in cells)
    print(f"{len(cells)} cells: " + ", ".join(f"{count} {verdict}" for verdict, count in counts.items()))


def _told(cell: CellChange) -> list[str]:
    told = [f"{change.quantity}{f', {change.channel}' if change.channel else ''} "
            f"{'got worse' if change.worse else 'changed'}" for change in cell.changes if change.changed]
    if cell.a and cell.b and cell.a != cell.b:
        told.append(f"its verdict was {cell.a}, and is {cell.b}")
    return [*told, *(f"note: {note}" for note in cell.notes)]


def _name(cell: CellChange) -> str:
    return " ".join([cell.scene, *(f"{name}={value}" for name, value in cell.parameters), cell.estimator])


def _of(cell: CellChange, quantity: Quantity) -> Change | None:
    return next((change for change in cell.changes if change.quantity == quantity), None)


def _worst(cell: CellChange) -> Change | None:
    """The channel whose mean moved farthest, in units of its interval."""
    found = [change for change in cell.changes if change.quantity == "mean error"]
    return max(found, key=lambda change: abs(change.difference) / (change.high - change.low)
               if change.high > change.low else 0.0, default=None)


def _difference(change: Change | None, *, percent: bool = False) -> str:
    if change is None or math.isnan(change.difference):
        return "–"
    if percent:
        return f"{change.difference:+.3%} [{change.low:+.3%}, {change.high:+.3%}]"
    sign = "+" if change.quantity == "slope" else ""
    return f"{change.difference:{sign}.3f} [{change.low:{sign}.3f}, {change.high:{sign}.3f}]"
