"""The report as plain values: words, tables and pictures, set by the typst template and by the HTML page alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Mark = Literal["", "pass", "fail", "inconclusive", "warning", "exact"]
Align = Literal["left", "center", "right"]

# A symbol beside each word, so that a verdict survives a black-and-white printer.
SYMBOLS: dict[Mark, str] = {"pass": "✓", "fail": "✗", "inconclusive": "?", "warning": "⚠", "exact": "="}


@dataclass(frozen=True)
class Swatch:
    """A strategy's marker and colour, as its curves have them."""

    glyph: str
    colour: str


@dataclass(frozen=True)
class Cell:
    """One cell of a table. `mark` colours it and puts its symbol in front; `rows`, `columns`: how many it spans.

    `target`: the anchor of the scene's section that the text leads to, if any.
    """

    text: str
    mark: Mark = ""
    swatch: Swatch | None = None
    rows: int = 1
    columns: int = 1
    target: str = ""


@dataclass(frozen=True)
class Column:
    """A column's heading and alignment, and its share of the width that is left over (0: as wide as its text)."""

    title: str
    align: Align = "left"
    share: float = 0.0


@dataclass(frozen=True)
class Table:
    """A table with its caption. A row has no cell where another spans; `rules`: indices of rows with a line above."""

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    rules: tuple[int, ...] = ()


@dataclass(frozen=True)
class Bar:
    """A colour bar: its image and the labels of its two ends and its middle."""

    file: str
    labels: tuple[str, str, str]


@dataclass(frozen=True)
class Picture:
    """One image: its file among the assets, the words above it and its colour bar, if it has one of its own."""

    file: str
    title: str
    alt: str
    bar: Bar | None = None
    swatch: Swatch | None = None


@dataclass(frozen=True)
class PictureRow:
    """Pictures side by side, with a heading and a colour bar that they share."""

    pictures: tuple[Picture, ...]
    title: str = ""
    bar: Bar | None = None


@dataclass(frozen=True)
class PictureFigure:
    """Rows of pictures under one caption."""

    caption: str
    rows: tuple[PictureRow, ...]


@dataclass(frozen=True)
class CurveFigure:
    """A vector figure (SVG among the assets) with its caption, so many centimetres wide."""

    caption: str
    file: str
    alt: str
    width: float = 17.0


@dataclass(frozen=True)
class Remark:
    """A sentence with a verdict's mark in front."""

    text: str
    mark: Mark = ""


@dataclass(frozen=True)
class SceneSection:
    """All that the report says about one scene, in the order in which it says it."""

    name: str
    anchor: str
    description: tuple[str, ...]
    facts: tuple[str, ...]
    remarks: tuple[Remark, ...]
    images: PictureFigure
    differences: PictureFigure | None
    curves: CurveFigure
    accuracy: Table
    reasons: tuple[Remark, ...]
    tiles: Table
    cost: Table | None


@dataclass(frozen=True)
class Listing:
    """Lines of code or of a compiler's message under a label; marked as wrong or right."""

    label: str
    text: str
    mark: Mark


@dataclass(frozen=True)
class ExhibitSection:
    """All that the report says about one of the handout's errors."""

    title: str
    anchor: str
    listings: tuple[Listing, ...]
    effect: str
    advice: str
    pictures: PictureFigure | None
    curves: CurveFigure | None
    findings: Table


@dataclass(frozen=True)
class Exhibits:
    """The handout's errors: what the chapter begins with, an overview, and one section an error."""

    title: str
    anchor: str
    introduction: str
    overview: Table
    sections: tuple[ExhibitSection, ...]


@dataclass(frozen=True)
class SuiteSection:
    """What is known of the gates' own errors: words, and each gate's rates and power as a table."""

    title: str
    introduction: str
    remarks: tuple[Remark, ...]
    gates: Table


@dataclass(frozen=True)
class CalibrationChapter:
    """What is known of the verdicts' own errors: words, in a table and a figure, and of the gates'."""

    title: str
    anchor: str
    introduction: str
    remarks: tuple[Remark, ...]
    alarms: Table
    power: CurveFigure
    suite: SuiteSection


@dataclass(frozen=True)
class MutantsChapter:
    """Seeded bugs: words, what each gate killed, and what became of each mutant."""

    title: str
    anchor: str
    introduction: str
    remarks: tuple[Remark, ...]
    gates: Table
    mutants: Table


@dataclass(frozen=True)
class Document:
    """The whole report. `assets` maps the file names used above to their bytes (PNG and SVG)."""

    title: str
    subtitle: str
    date: str
    summary: tuple[Remark, ...]
    verdicts: Table
    reading: tuple[tuple[str, str], ...]
    scenes: tuple[SceneSection, ...]
    speed: Table | None
    provenance: tuple[Table, ...]
    assets: dict[str, bytes]
    exhibits: Exhibits | None = None
    calibration: CalibrationChapter | None = None
    mutants: MutantsChapter | None = None
