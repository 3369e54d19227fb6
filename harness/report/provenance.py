"""Where the numbers come from: versions, machine, seeds, hashes, timings and the benchmark, as tables."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from harness.errors import StoreError
from harness.report import formats
from harness.report.content import Cell, Column, Mark, Table
from harness.results import StudyResult
from harness.stats.channels import Channel


def provenance_tables(results: Sequence[StudyResult], profile: str, elapsed: Mapping[str, float]) -> tuple[Table, ...]:
    """What all studies share, what each scene has of its own, the references, and where the time went."""
    shared, own = _split(results)
    settings = {"report profile": profile, **shared}
    tables = [Table("What all scenes share.", (Column("Setting"), Column("Value", share=1)),
                    tuple((Cell(_words(name)), Cell(value)) for name, value in settings.items()))]
    tables.append(_scene_table(results, own))
    tables.append(_reference_table(results))
    if elapsed:
        rows = [(Cell(stage), Cell(formats.duration(seconds))) for stage, seconds in elapsed.items()]
        tables.append(Table("Wall-clock time of the steps that led to this report.",
                            (Column("Step", share=1), Column("Time", "right")), tuple(rows)))
    return tuple(tables)


def _split(results: Sequence[StudyResult]) -> tuple[dict[str, str], dict[str, dict[str, str]]]:
    """Provenance that is the same in every study, and the rest as name -> scene -> value."""
    names = list(dict.fromkeys(name for result in results for name in result.provenance))
    values = {name: [result.provenance.get(name, formats.MISSING) for result in results] for name in names}
    shared = {name: held[0] for name, held in values.items() if len(results) > 1 and len(set(held)) == 1}
    own = {name: {result.scene: value for result, value in zip(results, held, strict=True)}
           for name, held in values.items() if name not in shared}
    return shared, own


def _words(name: str) -> str:
    """A setting's name in words: 'gl_renderer' -> 'GL renderer'."""
    return re.sub(r"^gl\b", "GL", name.replace("_", " "))


def _scene_table(results: Sequence[StudyResult], own: Mapping[str, Mapping[str, str]]) -> Table:
    """One row for each setting of a scene: settings vary in number, and their values in length."""
    rows: list[tuple[Cell, ...]] = []
    rules: list[int] = []
    for result in results:
        stops = f"{formats.number(result.exposure, 2, sign=True)} stops"
        settings = {"scene hash": result.scene_hash, "exposure": stops,
                    **{name: held[result.scene] for name, held in own.items()}}
        text = "; ".join(f"{_words(name)} {value}" for name, value in settings.items())
        rules.append(len(rows))
        rows.append((Cell(result.scene), Cell(text)))
    return Table("What each scene has of its own.", (Column("Scene"), Column("Settings", share=1)), tuple(rows),
                 tuple(rules))


def _reference_table(results: Sequence[StudyResult]) -> Table:
    rows = []
    for result in results:
        reference = result.reference
        mean, variance = (float(each[Channel.LUMINANCE]) for each in (reference.image_mean, reference.image_variance))
        error = np.sqrt(variance) / abs(mean) if mean else np.nan
        rows.append((Cell(result.scene), Cell(result.reference_kind),
                     Cell(formats.count(reference.samples) if reference.samples else "exact", ""),
                     Cell(formats.count(reference.batches) if reference.batches else formats.MISSING),
                     Cell(formats.significant(mean, 4)),
                     Cell(formats.percent(float(error)) if reference.samples else "0"),
                     Cell(formats.count(reference.rejected)),
                     Cell(formats.duration(reference.cpu_seconds) if reference.samples else formats.MISSING)))
    caption = ("The references. Mean: of luminance over the image, in the scene's radiance unit, and its relative "
               "standard error. Rejected: samples that were not finite.")
    columns = (Column("Scene", share=1), Column("Reference"), Column("Samples\nper pixel", "right"),
               Column("Batches", "right"), Column("Mean", "right"), Column("Standard\nerror", "right"),
               Column("Rejected", "right"), Column("CPU time", "right"))
    return Table(caption, columns, tuple(rows))


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
               Column("Verdict"), Column("Elapsed", "right"), Column("Equal\nerror", "right"))
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
