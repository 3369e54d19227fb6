"""Where the numbers come from: versions, machine, seeds, hashes and timings, as tables."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from harness.report import formats
from harness.report.blocks import Cell, Chapter, Column, Table
from harness.report.inputs import Inputs
from harness.results import StudyResult
from harness.stats.channels import Channel

PLACE = 70
TITLE, ANCHOR = "Provenance", "provenance"


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, on the page of the limits."""
    tables = provenance_tables(inputs.results, inputs.profile, inputs.elapsed)
    yield Chapter(TITLE, ANCHOR, tuple(replace(table, long=True) for table in tables), follows_on=True)


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
                     Cell(formats.duration(reference.cost.seconds) if reference.samples else formats.MISSING)))
    caption = ("The references. Mean: of luminance over the image, in the scene's radiance unit, and its relative "
               "standard error. Rejected: samples that were not finite.")
    columns = (Column("Scene", share=1), Column("Reference"), Column("Samples\nper pixel", "right"),
               Column("Batches", "right"), Column("Mean", "right"), Column("Standard\nerror", "right"),
               Column("Rejected", "right"), Column("Time", "right"))
    return Table(caption, columns, tuple(rows))
