"""The report as one self-contained HTML page, from the same document as the PDF."""

from __future__ import annotations

import base64
import hashlib
import io
import re
from collections.abc import Callable, Iterable, Sequence
from html import escape
from importlib import metadata
from pathlib import Path
from typing import Any
from urllib.parse import quote

from harness.report.blocks import (
    SYMBOLS,
    Asset,
    Bar,
    Cell,
    Chapter,
    CrossReference,
    Curves,
    Document,
    Facts,
    Formula,
    Heading,
    Listings,
    Paragraph,
    Picture,
    Pictures,
    Pointer,
    Remarks,
    Swatch,
    Table,
    Terms,
    Works,
)
from harness.report.figures.style import FONT, font_folder
from harness.report.pages.embedded import POLICY, palettes_script, pixels_script, scripts
from harness.report.pages.frame import framed
from harness.report.pages.mathml import mathml
from harness.samples.keys import code_digest
from harness.samples.memo import remembered_bytes

_FONT_NAME = "Report STIX"

# Cells with more letters than this may break their lines; numbers never do.
_LONG_CELL = 40
# The width of text on paper, which figures are drawn for.
_PAGE_CM = 17.0


def html_page(document: Document) -> str:
    """One HTML file that holds its images (PNG data), their numbers, its figures (inline SVG) and its scripts.

    It needs nothing else, and without scripts it shows the pictures."""
    links = "".join(f'<a href="#{chapter.anchor}">{escape(chapter.title)}</a>'
                    for chapter in document.chapters if chapter.title)
    parts = [
        f"<h1>{escape(document.title)}</h1>",
        f'<p class="subtitle">{escape(document.subtitle)} · {escape(document.date)}</p>', f"<nav>{links}</nav>",
        *(_chapter(chapter) for chapter in document.chapters)]
    style = Path(__file__).with_name("report.css").read_text(encoding="utf-8")
    return framed(document.title, _font_face(document) + style, "\n".join(parts), policy=POLICY,
                  scripts=f"{palettes_script()}\n{scripts()}\n")


def _font_face(document: Document) -> str:
    """The figures' font, cut down to the letters that they use: their layout was measured with it.

    The STIX fonts' licence (SIL OFL 1.1) permits embedding; the renamed family keeps an installed one apart.
    """
    letters = set().union(*(assets.decode() for name, assets in document.assets().items() if name.endswith(".svg")))
    whole = (font_folder() / f"{FONT}.ttf").read_bytes()
    key = [code_digest(__name__), metadata.version("fonttools"), hashlib.sha256(whole).hexdigest(), sorted(letters)]
    cut = remembered_bytes("pages", key, lambda: _cut_down(whole, letters))
    source = f"data:font/woff;base64,{base64.b64encode(cut).decode()}"
    return f'@font-face {{ font-family: "{_FONT_NAME}"; src: url({source}) format("woff"); }}\n'


def _cut_down(font: bytes, letters: Iterable[str]) -> bytes:
    """The font (TTF) with the glyphs of some letters alone, as WOFF."""
    from fontTools import subset  # type: ignore[import-untyped]  # matplotlib itself requires it
    from fontTools.ttLib import TTFont  # type: ignore[import-untyped]

    options = subset.Options(layout_features=[], hinting=False, notdef_outline=True)
    options.drop_tables += ["FFTM"]  # a font editor's time stamps
    cutter = subset.Subsetter(options)
    cutter.populate(unicodes=[ord(letter) for letter in letters])
    made = TTFont(io.BytesIO(font))
    cutter.subset(made)
    buffer = io.BytesIO()
    made.flavor = "woff"
    made.save(buffer)
    return buffer.getvalue()


def _chapter(chapter: Chapter) -> str:
    title = f'<h2 id="{chapter.anchor}">{escape(chapter.title)}</h2>' if chapter.title else ""
    text = "\n".join(part for part in (title, *(_BLOCKS[type(block)](block) for block in chapter.blocks)) if part)
    return text if chapter.language == "en" else f'<section lang="{chapter.language}">{text}</section>'


def _heading(heading: Heading) -> str:
    anchor = f' id="{heading.anchor}"' if heading.anchor else ""
    return f"<h3{anchor}>{escape(heading.title)}</h3>"


def _paragraph(paragraph: Paragraph) -> str:
    lead = f"<b>{_text(paragraph.lead)}</b> " if paragraph.lead else ""
    return f"<p>{lead}{_linked(paragraph.text, paragraph.links)}</p>"


def _linked(text: str, links: Sequence[CrossReference]) -> str:
    """Text whose parts lead elsewhere."""
    if not links:
        return _text(text)
    first, rest = links[0], links[1:]
    joint = f'<a href="#{first.target}">{_text(first.words)}</a>'
    return joint.join(_linked(part, rest) for part in text.split(first.words))


def _formula(formula: Formula) -> str:
    return f'<p class="formula">{mathml(formula.source)}</p>'


def _works(works: Works) -> str:
    items = "".join(f'<li id="{work.anchor}"><span>[{work.number}]</span> {_text(work.text)}</li>'
                    for work in works.items)
    return f'<ul class="works">{items}</ul>'


def _facts(facts: Facts) -> str:
    return f'<p class="facts">{"".join(f"<span>{_text(fact)}</span>" for fact in facts.items)}</p>'


def _terms(terms: Terms) -> str:
    return f"<dl>{''.join(f'<dt>{escape(term.name)}</dt><dd>{_text(term.meaning)}</dd>' for term in terms.items)}</dl>"


def _pointer(pointer: Pointer) -> str:
    return f'<p><a href="#{pointer.target}">{_text(pointer.text)}</a>.</p>'


def _listings(listings: Listings) -> str:
    return "".join(f'<div class="listing"><span class="{item.mark}">{escape(item.label)}</span>'
                   f"<pre>{escape(item.text)}</pre></div>" for item in listings.items)


def _text(text: str) -> str:
    """Escaped text, with verdict symbols coloured."""
    shown = escape(text)
    for mark, symbol in SYMBOLS.items():
        if mark in ("pass", "fail", "warning"):  # the others are ordinary characters
            shown = shown.replace(symbol, f'<span class="mark {mark}">{symbol}</span>')
    return shown


def _mark(mark: str, symbol: str | None) -> str:
    return f'<span class="mark {mark}">{symbol}</span>' if symbol else '<span class="mark">·</span>'


def _remarks(remarks: Remarks) -> str:
    items = "".join(f"<li>{_mark(r.mark, SYMBOLS.get(r.mark))}{_text(r.text)}</li>" for r in remarks.items)
    return f'<ul class="remarks{" small" if remarks.small else ""}">{items}</ul>' if items else ""


def _table(table: Table) -> str:
    head = "".join(f'<th class="{c.align}">{escape(c.title)}</th>' for c in table.columns)
    body = []
    spanned: dict[int, int] = {}  # column -> rows below that a cell still covers
    for index, row in enumerate(table.rows):
        cells, column, waiting = [], 0, list(row)
        while column < len(table.columns):
            if spanned.get(column, 0):
                spanned[column] -= 1
                column += 1
                continue
            cell = waiting.pop(0)
            wide = len(cell.text) > _LONG_CELL or bool(cell.links)
            cells.append(_cell(cell, table.columns[column].align, wide=wide))
            for covered in range(column, column + cell.columns):
                spanned[covered] = cell.rows - 1
            column += cell.columns
        body.append(f'<tr class="rule">{"".join(cells)}</tr>' if index in table.rules else f"<tr>{''.join(cells)}</tr>")
    return (f'<figure class="table"><figcaption>{_text(table.caption)}</figcaption><div class="scroll"><table><thead>'
            f"<tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table></div></figure>")


def _cell(cell: Cell, align: str, *, wide: bool) -> str:
    text = escape(cell.text)
    if cell.target:
        text = f'<a href="#{cell.target}">{text.replace("_", "_<wbr>")}</a>'
    if cell.mark:
        text = f'<span class="{cell.mark}">{_mark(cell.mark, SYMBOLS[cell.mark])} {text}</span>'
    links = " · ".join(f'<a href="{escape(quote(link.path))}">{escape(link.text)}</a>' for link in cell.links)
    text = " ".join(part for part in (text, links) if part)
    spans = (f' rowspan="{cell.rows}"' if cell.rows > 1 else "") + (
        f' colspan="{cell.columns}"' if cell.columns > 1 else "")
    classes = f"{align}{' wide' if wide else ''}" if cell.columns == 1 else "left"
    return f'<td class="{classes}"{spans}>{_swatch(cell.swatch)}{text}</td>'


def _swatch(swatch: Swatch | None) -> str:
    return f'<span class="swatch" style="color:{swatch.colour}">{swatch.glyph}</span>' if swatch else ""


def _pictures(figure: Pictures) -> str:
    rows = []
    for row in figure.rows:
        if row.title:
            bar = _bar(row.bar) if row.bar else ""
            rows.append(f'<div class="rowhead"><span>{escape(row.title)}</span>{bar}</div>')
        columns = max(len(row.pictures), 1 if figure.large else 4)
        rows.append(f'<div class="pictures" style="grid-template-columns: repeat({columns}, 1fr)">'
                    f"{''.join(_picture(picture) for picture in row.pictures)}</div>")
    pixels = pixels_script(figure.pixels) if figure.pixels else ""
    return f"<figure>{pixels}{''.join(rows)}<figcaption>{_text(figure.caption)}</figcaption></figure>"


def _picture(picture: Picture) -> str:
    title = f"<p>{_swatch(picture.swatch)}{escape(picture.title)}</p>" if picture.title else ""
    bar = _bar(picture.bar) if picture.bar else ""
    return f'<div>{title}<img alt="{escape(picture.alt)}" src="{_image(picture.file)}">{bar}</div>'


def _bar(bar: Bar) -> str:
    labels = "".join(f"<span>{escape(label)}</span>" for label in bar.labels)
    return f'<div class="bar"><img alt="colour bar" src="{_image(bar.file)}"><div>{labels}</div></div>'


def _image(file: Asset) -> str:
    kind = "jpeg" if file.name.endswith(".jpg") else "png"
    return f"data:image/{kind};base64,{base64.b64encode(file.content).decode()}"


def _curves(figure: Curves) -> str:
    svg, name = figure.file.content.decode(), figure.file.name.rpartition(".")[0]
    svg = svg[svg.index("<svg"):]
    # Several figures share one page, so each needs its own names for clip paths and markers.
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'(url\(|xlink:href=")#', rf"\g<1>#{name}-", svg)
    svg = svg.replace(f"'{FONT}'", f"'{_FONT_NAME}'")
    svg = svg.replace("<svg", f'<svg role="img" aria-label="{escape(figure.alt)}"', 1)
    share = f' style="--share: {figure.width / _PAGE_CM:.2f}"' if figure.width < _PAGE_CM else ""
    caption = f"<figcaption>{_text(figure.caption)}</figcaption>"
    return f'<figure class="curves"{share}><div class="scroll">{svg}</div>{caption}</figure>'


_BLOCKS: dict[type, Callable[[Any], str]] = {
    Heading: _heading, Paragraph: _paragraph, Formula: _formula, Works: _works, Facts: _facts, Remarks: _remarks,
    Terms: _terms, Pointer: _pointer, Table: _table, Pictures: _pictures, Curves: _curves, Listings: _listings}
