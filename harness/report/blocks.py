"""The report as plain values: chapters made of a few kinds of blocks, which every medium can set.

A medium (`pages/html.py`, `reports/report.typ`) knows these kinds and no chapter; a chapter (`chapters/`) knows these
kinds and no medium. So a new chapter needs no medium, and a new kind of block one function in each.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any, Literal, get_args

from harness.errors import HarnessError
from harness.report.pixels import Pixels

Mark = Literal["", "pass", "fail", "inconclusive", "warning", "exact"]
Align = Literal["left", "center", "right"]

# A symbol beside each word, so that a verdict survives a black-and-white printer.
SYMBOLS: dict[Mark, str] = {"pass": "✓", "fail": "✗", "inconclusive": "?", "warning": "⚠", "exact": "="}


@dataclass(frozen=True)
class Asset:
    """A PNG or SVG file of the report: its name, the only one of that name in a report, and its bytes."""

    name: str
    content: bytes = field(repr=False)


@dataclass(frozen=True)
class Swatch:
    """A strategy's marker and colour, as its curves have them."""

    glyph: str
    colour: str


@dataclass(frozen=True)
class Link:
    """Words that lead to a file beside the report, by its path from there; a medium on paper says the words alone."""

    text: str
    path: str


@dataclass(frozen=True)
class Cell:
    """One cell of a table. `mark` colours it and puts its symbol in front; `rows`, `columns`: how many it spans.

    `target`: the anchor of the chapter or heading that the text leads to, if any; `links` follow the text.
    """

    text: str
    mark: Mark = ""
    swatch: Swatch | None = None
    rows: int = 1
    columns: int = 1
    target: str = ""
    links: tuple[Link, ...] = ()


@dataclass(frozen=True)
class Column:
    """A column's heading and alignment, and its share of the width that is left over (0: as wide as its text)."""

    title: str
    align: Align = "left"
    share: float = 0.0


@dataclass(frozen=True)
class Bar:
    """A colour bar: its image and the labels of its two ends and its middle."""

    file: Asset
    labels: tuple[str, str, str]


@dataclass(frozen=True)
class Picture:
    """One image, the words above it and its colour bar, if it has one of its own; `alt`: for who does not see it."""

    file: Asset
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
class Remark:
    """A sentence with a verdict's mark in front."""

    text: str
    mark: Mark = ""


@dataclass(frozen=True)
class CrossReference:
    """Words inside a text, and the anchor that they lead to."""

    words: str
    target: str


@dataclass(frozen=True)
class Work:
    """A work that the report cites: its number, the anchor that citations lead to, and what it is."""

    number: int
    anchor: str
    text: str


@dataclass(frozen=True)
class Term:
    """A word of the report and what a reader needs to judge by it."""

    name: str
    meaning: str


# ---- the kinds of blocks


@dataclass(frozen=True)
class Heading:
    """A title inside a chapter. With an `anchor` it begins a section, which links and bookmarks lead to."""

    title: str
    anchor: str = ""


@dataclass(frozen=True)
class Paragraph:
    """Running text; `lead`: words in bold that it begins with; `links`: parts of the text that lead elsewhere."""

    text: str
    lead: str = ""
    links: tuple[CrossReference, ...] = ()


@dataclass(frozen=True)
class Formula:
    """A displayed formula in Typst's notation for mathematics, as far as `pages.mathml` reads it."""

    source: str


@dataclass(frozen=True)
class Works:
    """The works that the report cites."""

    items: tuple[Work, ...]


@dataclass(frozen=True)
class Facts:
    """Short facts on one line, small and soft."""

    items: tuple[str, ...]


@dataclass(frozen=True)
class Remarks:
    """Sentences, each with its mark; `small`: of those who look closer."""

    items: tuple[Remark, ...]
    small: bool = False


@dataclass(frozen=True)
class Terms:
    """Words with their meanings."""

    items: tuple[Term, ...]


@dataclass(frozen=True)
class Pointer:
    """Words that lead to another chapter, by its page on paper."""

    text: str
    target: str


@dataclass(frozen=True)
class Table:
    """A table with its caption. A row has no cell where another spans; `rules`: indices of rows with a line above.

    `long`: it may go on over pages, its heading repeated on each.
    """

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    rules: tuple[int, ...] = ()
    long: bool = False


@dataclass(frozen=True)
class Pictures:
    """Rows of pictures under one caption. `pixels`: what they show in numbers, for a medium in which one can look
    closer; it stands in for the pictures there. `large`: each row as wide as the page, however few are in it."""

    caption: str
    rows: tuple[PictureRow, ...]
    pixels: Pixels | None = None
    large: bool = False


@dataclass(frozen=True)
class Curves:
    """A vector figure (SVG) with its caption, so many centimetres wide."""

    caption: str
    file: Asset
    alt: str
    width: float = 17.0


@dataclass(frozen=True)
class Listing:
    """Lines of code or of a compiler's message under a label; marked as wrong or right."""

    label: str
    text: str
    mark: Mark


@dataclass(frozen=True)
class Listings:
    """Listings that belong together, to be compared."""

    items: tuple[Listing, ...]


Block = (Heading | Paragraph | Formula | Works | Facts | Remarks | Terms | Pointer | Table | Pictures | Curves
         | Listings)
KINDS: tuple[type, ...] = get_args(Block)


@dataclass(frozen=True)
class Chapter:
    """A chapter: its title, the anchor that links lead to, and its blocks in order.

    It begins a page, unless it `follows_on`. Without a title it is the first one, which stands under the report's own.
    `language`: of its words, as a BCP 47 tag.
    """

    title: str
    anchor: str
    blocks: tuple[Block, ...]
    follows_on: bool = False
    language: str = "en"


@dataclass(frozen=True)
class Document:
    """The whole report, for every medium."""

    title: str
    subtitle: str
    date: str
    chapters: tuple[Chapter, ...]

    def assets(self) -> Mapping[str, bytes]:
        """The bytes of all pictures and figures, by name. HarnessError where two have one name."""
        return self._assets

    def json(self) -> str:
        """The words and tables as JSON, a chapter a line; each block says its `kind`, and pictures are names of
        files."""
        return self._json

    @cached_property
    def _assets(self) -> Mapping[str, bytes]:
        found: dict[str, bytes] = {}
        for asset in _assets(self.chapters):
            if found.setdefault(asset.name, asset.content) != asset.content:
                raise HarnessError(f"two different figures of a report are called '{asset.name}'; give each its own "
                                   "name in its chapter")
        return found

    @cached_property
    def _json(self) -> str:
        head = _json({"title": self.title, "subtitle": self.subtitle, "date": self.date, "symbols": SYMBOLS})
        chapters = ",\n".join(map(_json, self.chapters))
        return f'{head[:-1]}, "chapters": [\n{chapters}\n]}}\n'


def _json(value: Any) -> str:
    return json.dumps(value, default=_plain, ensure_ascii=False)


def _plain(value: Any) -> Any:
    """One step towards JSON of what is none yet."""
    if isinstance(value, Asset):
        return value.name
    if isinstance(value, Pixels):  # nothing for paper
        return None
    kind = {"kind": type(value).__name__} if isinstance(value, KINDS) else {}
    return {**kind, **{name: getattr(value, name) for name in _fields(value.__class__)}}


@cache
def _fields(kind: Hashable) -> tuple[str, ...]:
    """Names of a dataclass's fields; of anything else nothing."""
    return tuple(each.name for each in dataclasses.fields(kind)) if dataclasses.is_dataclass(kind) else ()


def _assets(value: Any) -> Iterator[Asset]:
    """Every asset anywhere inside a value."""
    waiting = [value]
    while waiting:
        value = waiting.pop()
        if isinstance(value, Asset):
            yield value
        elif isinstance(value, tuple):
            waiting += reversed(value)
        elif not isinstance(value, str):
            waiting += [getattr(value, name) for name in reversed(_fields(value.__class__))]
