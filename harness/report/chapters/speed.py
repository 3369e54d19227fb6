"""The chapter on speed: the benchmark as a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from harness.errors import StoreError
from harness.report import formats
from harness.report.blocks import Cell, Chapter, Column, Mark, Table
from harness.report.inputs import Inputs

PLACE = 60
TITLE, ANCHOR = "Speed", "speed"


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, where a benchmark was run."""
    if inputs.bench:
        yield Chapter(TITLE, ANCHOR, (speed_table(inputs.bench),))


def speed_table(bench: Mapping[str, Any]) -> Table:
    """The benchmark as a table, from what `bench.save` writes: `rows`, one a measured case.

    StoreError when `bench` is not of that form.
    """
    try:
        rows = [_speed_row(row) for row in bench["rows"]]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise StoreError(f"benchmark results: {type(error).__name__} at {error}; run the benchmark again") from error
    caption = (
        "Speed: millions of samples (paths) per second of CPU time, the GLSL tracer and what it is measured against in "
        "turns in one run on the same cores. Medians over the rounds; of their ratio also the extremes. path: "
        "Mitsuba's own path tracer, which samples light sources as well; bsdf_path: the tracer's algorithm as a "
        "Mitsuba integrator; no lens, no motion: the tracer itself on the same scene without it. "
        "Elapsed: the ratio by wall clock. Equal error: the ratio of 1 / (variance × CPU time), how much sooner the "
        "tracer reaches the same error.")
    columns = (Column("Scene", share=1), Column("Strategy"), Column("Against"), Column("GLSL\nM/s", "right"),
               Column("Other\nM/s", "right"), Column("Ratio", "right"), Column("Target", "right"),
               Column("Result"), Column("Elapsed", "right"), Column("Equal\nerror", "right"))
    return Table(caption, columns, tuple(rows))


def _speed_row(row: Mapping[str, Any]) -> tuple[Cell, ...]:
    value, low, high, needed = (float(row[name]) for name in ("ratio", "low", "high", "needed"))
    mark: Mark = "pass" if value >= needed else "fail"
    rates = (Cell(formats.significant(float(row[name]))) for name in ("tracer_rate", "opponent_rate"))
    others = (Cell(f"{formats.significant(float(row[name]), 2)}{formats.TIMES}")
              for name in ("wall_ratio", "efficiency_ratio"))
    return (Cell(str(row["scene"])), Cell(str(row["strategy"])), Cell(str(row["opponent"])), *rates,
            Cell(formats.ratio(value, low, high)), Cell(f"≥{formats.NBSP}{needed:g}{formats.TIMES}"),
            Cell("reached" if mark == "pass" else "missed", mark), *others)
