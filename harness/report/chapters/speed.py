"""The chapter on speed: the benchmark as a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from harness.report import formats
from harness.report.blocks import Cell, Chapter, Column, Mark, Paragraph, Table
from harness.report.inputs import Inputs
from harness.results import BenchRow, SamplerRow

PLACE = 60
TITLE, ANCHOR = "Speed", "speed"


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, where a benchmark was run."""
    if inputs.bench:
        yield Chapter(TITLE, ANCHOR, (speed_table(inputs.bench.rows), *_equal_error(inputs.bench.samplers)))


def speed_table(rows: Sequence[BenchRow]) -> Table:
    """The benchmark as a table, one row a measured case."""
    caption = (
        "Speed: millions of samples (paths) per second, by the clock that counts on the device (the CPU's or the "
        "GPU's), the GLSL tracer and what it is measured against in turns in one run. Medians over the rounds; of "
        "their ratio also the extremes. path: Mitsuba's own path tracer, which samples light sources as well; "
        "bsdf_path: the tracer's algorithm as a Mitsuba integrator; no lens, no motion: the tracer itself on the same "
        "scene without it. "
        "Elapsed: the ratio by wall clock. Equal error: the ratio of 1 / (variance × time), how much sooner the "
        "tracer reaches the same error, where both draw independent samples.")
    columns = (Column("Scene", share=1), Column("Strategy"), Column("Against"), Column("GLSL\nM/s", "right"),
               Column("Other\nM/s", "right"), Column("Ratio", "right"), Column("Target", "right"),
               Column("Result"), Column("Elapsed", "right"), Column("Equal\nerror", "right"))
    return Table(caption, columns, tuple(map(_row, rows)))


def _equal_error(rows: Sequence[SamplerRow]) -> Iterator[Paragraph | Table]:
    """Mitsuba's samplers, where they were measured: what the best leaves of the tracer's lead, and the table."""
    best = [row for row in rows if row.best]
    if not best:
        return
    least, most = min(best, key=lambda row: row.ratio), max(best, key=lambda row: row.ratio)
    yield Paragraph(
        "More samples a second are not the same error sooner: Mitsuba's other samplers stratify what the tracer draws "
        f"independently. Against the best of them the tracer reaches the same error {_times(least.ratio)} "
        f"({least.scene}, {least.sampler}) to {_times(most.ratio)} ({most.scene}, {most.sampler}) as soon.")
    caption = (
        "The same error, by the clock that counts: 1 / (variance of a replica × time) of Mitsuba's samplers and of the "
        "tracer, in turns in one run. Variance is that of whole replicas, since samples of one depend on each other. "
        "Gain: over Mitsuba's independent sampler. Tracer: how much sooner it gets there than Mitsuba does with this "
        f"sampler, with its 95{formats.NBSP}% interval.")
    columns = (Column("Scene", share=1), Column("Strategy"), Column("Integrator"), Column("Sampler"),
               Column("spp", "right"), Column("Gain", "right"), Column("Tracer", "right"), Column("Best"))
    yield Table(caption, columns, tuple(
        (Cell(row.scene), Cell(row.strategy), Cell(row.integrator), Cell(row.sampler), Cell(str(row.spp)),
         Cell(_times(row.gain)), Cell(formats.ratio(row.ratio, row.low, row.high)), Cell("best" if row.best else ""))
        for row in rows))


def _times(ratio: float) -> str:
    return f"{formats.significant(ratio, 2)}{formats.TIMES}"


def _row(row: BenchRow) -> tuple[Cell, ...]:
    mark: Mark = "pass" if row.ratio >= row.needed else "fail"
    rates = (Cell(formats.significant(rate)) for rate in (row.tracer_rate, row.opponent_rate))
    others = (Cell(f"{formats.significant(ratio, 2)}{formats.TIMES}")
              for ratio in (row.wall_ratio, row.efficiency_ratio))
    return (Cell(row.scene), Cell(row.strategy), Cell(row.opponent), *rates,
            Cell(formats.ratio(row.ratio, row.low, row.high)), Cell(f"≥{formats.NBSP}{row.needed:g}{formats.TIMES}"),
            Cell("reached" if mark == "pass" else "missed", mark), *others)
