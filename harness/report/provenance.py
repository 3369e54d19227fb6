"""Where the numbers come from: versions, machine, seeds, hashes, timings and the benchmark, as tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from harness.errors import StoreError
from harness.report import formats
from harness.report.content import Cell, Column, Mark, Table
from harness.results import StudyResult


def provenance_tables(results: Sequence[StudyResult], profile: str, elapsed: Mapping[str, float]) -> tuple[Table, ...]:
    """What all studies share, what each scene has of its own, the references, and where the time went."""
    shared, own = _split(results)
    tables = [Table("What all scenes share.", (Column("Setting"), Column("Value", share=1)),
                    tuple((Cell(name), Cell(value)) for name, value in {"report profile": profile, **shared}.items()))]
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


def _scene_table(results: Sequence[StudyResult], own: Mapping[str, Mapping[str, str]]) -> Table:
    """One row for each setting of a scene: settings vary in number, and their values in length."""
    rows, rules = [], []
    for result in results:
        stops = f"{formats.number(result.exposure, 2, sign=True)} stops"
        settings = {"scene hash": result.scene_hash, "exposure": stops,
                    **{name: held[result.scene] for name, held in own.items()}}
        text = "; ".join(f"{name} {value}" for name, value in settings.items())
        rules.append(len(rows))
        rows.append((Cell(result.scene), Cell(text)))
    return Table("What each scene has of its own.", (Column("Scene"), Column("Settings", share=1)), tuple(rows),
                 tuple(rules))


def _reference_table(results: Sequence[StudyResult]) -> Table:
    rows = []
    for result in results:
        reference = result.reference
        mean, variance = float(reference.image_mean[3]), float(reference.image_variance[3])
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
    """The benchmark as a table. StoreError when `bench` is not of this form:

    `comparisons`: a list of objects with `scene`, `strategy`, `opponent` (words), `glsl_samples_per_second`,
    `opponent_samples_per_second` (per second of CPU time), `ratio`, `low`, `high` and `target` (the least ratio asked
    for, or None). `note`: words for the caption, optional.
    """
    rows = []
    try:
        for row in bench["comparisons"]:
            target = row["target"]
            mark: Mark = "" if target is None else "pass" if row["ratio"] >= target else "fail"
            rows.append((Cell(str(row["scene"])), Cell(str(row["strategy"])), Cell(str(row["opponent"])),
                         Cell(_mega(row["glsl_samples_per_second"])), Cell(_mega(row["opponent_samples_per_second"])),
                         Cell(formats.ratio(row["ratio"], row["low"], row["high"])),
                         Cell(formats.MISSING if target is None else f"≥{formats.NBSP}{target:g}{formats.TIMES}"),
                         Cell(mark or formats.MISSING, mark)))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise StoreError(f"benchmark results: {type(error).__name__} at {error}; run the benchmark again") from error
    caption = ("Speed: millions of samples per second of CPU time, GLSL and opponent in turns in one run on the same "
               "cores; medians, and their ratio with its spread. " + str(bench.get("note", ""))).strip()
    columns = (Column("Scene"), Column("Strategy"), Column("Against", share=1), Column("GLSL\nM/s", "right"),
               Column("Opponent\nM/s", "right"), Column("Ratio", "right"), Column("Target", "right"),
               Column("Verdict"))
    return Table(caption, columns, tuple(rows))


def _mega(rate: float) -> str:
    return formats.significant(rate / 1e6)
