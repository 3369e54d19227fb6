"""The chapter on speed: what samples cost on each device, and the benchmark as a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from harness.report import formats
from harness.report.blocks import Block, Cell, Chapter, Column, Mark, Paragraph, Table
from harness.report.inputs import Inputs
from harness.results import BenchRow, EntrantRow, StudyResult
from harness.stats.rates import CONFIDENCE

PLACE = 60
TITLE, ANCHOR = "Speed", "speed"


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, where any time was measured."""
    blocks: list[Block] = []
    if inputs.bench:
        blocks += [speed_table(inputs.bench.rows), *_equal_error(inputs.bench.entrants)]
    blocks += _by_device(inputs.results)
    if blocks:
        yield Chapter(TITLE, ANCHOR, tuple(blocks))


def _by_device(results: Sequence[StudyResult]) -> Iterator[Table]:
    """How fast each device drew the samples of the studies: a row a strategy, and one for the reference."""
    rates: dict[tuple[str, str], list[tuple[float, str]]] = {}
    for result in results:
        for strategy in result.strategies:
            pixels = strategy.estimate.mean[..., 0].size
            if strategy.device:
                rates.setdefault((strategy.device, f"tracer, {strategy.strategy}"), []).append(
                    (pixels / strategy.seconds_per_spp / 1e6, result.scene))
        cost = result.reference.cost
        if cost.device and result.reference.samples:
            drawn = result.reference.samples * result.reference.mean[..., 0].size
            rates.setdefault((cost.device, f"reference, {result.reference_kind}"), []).append(
                (drawn / cost.seconds / 1e6, result.scene))
    rows: list[tuple[Cell, ...]] = []
    rules: list[int] = []
    for device in dict.fromkeys(device for device, _ in rates):
        mine = [(name, found) for (of, name), found in rates.items() if of == device]
        mine.sort(key=lambda each: each[0].startswith("reference"))
        rules.append(len(rows))
        for index, (name, found) in enumerate(mine):
            first = (Cell(device, rows=len(mine)),) if index == 0 else ()
            rows.append((*first, Cell(name), Cell(formats.count(len(found))),
                         Cell(formats.significant(float(np.median([rate for rate, _ in found])), 3)),
                         *(Cell(f"{formats.significant(rate, 3)} "
                                f"({scene})") for rate, scene in (min(found), max(found)))))
    if rows:
        columns = (Column("Device", share=1), Column("Renderer"), Column("Scenes", "right"),
                   Column("Middle\nM/s", "right"), Column("Least\nM/s", "right"), Column("Most\nM/s", "right"))
        yield Table("Samples of the studies by the device that drew them, in millions a second by the clock that "
                    "counts there: the middle of the scenes, and the extremes. Strategies are shown on different "
                    "scenes, so rows do not compare; devices never do.", columns, tuple(rows), tuple(rules), long=True)


def speed_table(rows: Sequence[BenchRow]) -> Table:
    """The benchmark as a table, one row a measured case."""
    caption = (
        "Speed: millions of samples (paths) per second, by the clock that counts on the device (the CPU's or the "
        "GPU's), the GLSL tracer and what it is measured against in turns in one run. Medians over the rounds; of "
        "their ratio also the extremes. path: Mitsuba's own path tracer, which samples light sources as well; "
        "bsdf_path: the tracer's algorithm as a Mitsuba integrator; no lens, no motion: the tracer itself on the same "
        "scene without it. Entry: which of the tracer's two shaders was run, where both were. "
        "Elapsed: the ratio by wall clock. Equal error: the ratio of 1 / (variance × time), how much sooner the "
        "tracer reaches the same error, where both draw independent samples.")
    columns = (Column("Scene", share=1), Column("Strategy"), Column("Entry"), Column("Against"),
               Column("GLSL\nM/s", "right"), Column("Other\nM/s", "right"), Column("Ratio", "right"),
               Column("Target", "right"), Column("Result"), Column("Elapsed", "right"), Column("Equal\nerror", "right"))
    return Table(caption, columns, tuple(map(_row, rows)))


def _equal_error(rows: Sequence[EntrantRow]) -> Iterator[Paragraph | Table]:
    """Who reaches the same error how soon, where that was measured: the best of each scene first, then all."""
    best = [row for row in rows if row.best and row.renderer == "tracer"]
    if not best:
        return
    least, most = min(best, key=lambda row: row.ratio), max(best, key=lambda row: row.ratio)
    yield Paragraph(
        "More samples a second are not the same error sooner: a sampled light and numbers that are spread evenly make "
        "samples worth more, in both renderers. On each scene the tracer's best strategy and sampler were held against "
        f"Mitsuba's path integrator with the best of Mitsuba's samplers: it reaches the same error "
        f"{_times(least.ratio)} ({least.scene}, {least.strategy} {least.sampler}) to {_times(most.ratio)} "
        f"({most.scene}, {most.strategy} {most.sampler}) as soon.")
    caption = (
        "The same error, by the clock that counts: 1 / (variance of a replica × time), in turns in one run, as a "
        "multiple of Mitsuba's path integrator with its best sampler, which is named, and the "
        f"{formats.share(CONFIDENCE)} interval. Variance is that of whole replicas, since samples of one depend on "
        "each other.")
    samplers = list(dict.fromkeys(row.sampler for row in rows if row.renderer == "tracer"))
    columns = (Column("Scene", share=1), Column("Mitsuba's best"), Column("Strategy"),
               *(Column(sampler, "right") for sampler in samplers), Column("Best"))
    yield Table(caption, columns, tuple(_entered(rows, samplers)))


def _entered(rows: Sequence[EntrantRow], samplers: Sequence[str]) -> Iterator[tuple[Cell, ...]]:
    """One row a scene and strategy, with a cell for each of the tracer's samplers."""
    for scene in dict.fromkeys(row.scene for row in rows):
        of_scene = [row for row in rows if row.scene == scene]
        theirs = next((row.sampler for row in of_scene if row.best and row.renderer != "tracer"), "")
        ours = {(row.strategy, row.sampler): row for row in of_scene if row.renderer == "tracer"}
        for number, strategy in enumerate(strategies := list(dict.fromkeys(strategy for strategy, _ in ours))):
            first = (Cell(scene, rows=len(strategies)), Cell(theirs, rows=len(strategies))) if number == 0 else ()
            found = [ours.get((strategy, sampler)) for sampler in samplers]
            winner = next((row.sampler for row in found if row is not None and row.best), "")
            yield (*first, Cell(strategy),
                   *(Cell(formats.ratio(row.ratio, row.low, row.high) if row else "") for row in found), Cell(winner))


def _times(ratio: float) -> str:
    return f"{formats.significant(ratio, 2)}{formats.TIMES}"


def _row(row: BenchRow) -> tuple[Cell, ...]:
    mark: Mark = "pass" if row.ratio >= row.needed else "fail"
    rates = (Cell(formats.significant(rate)) for rate in (row.tracer_rate, row.opponent_rate))
    others = (Cell(f"{formats.significant(ratio, 2)}{formats.TIMES}")
              for ratio in (row.wall_ratio, row.efficiency_ratio))
    return (Cell(row.scene), Cell(row.strategy), Cell(row.entry), Cell(row.opponent), *rates,
            Cell(formats.ratio(row.ratio, row.low, row.high)), Cell(f"≥{formats.NBSP}{row.needed:g}{formats.TIMES}"),
            Cell("reached" if mark == "pass" else "missed", mark), *others)
