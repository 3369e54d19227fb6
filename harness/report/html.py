"""The report as one self-contained HTML page, from the same document as the PDF."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Iterable
from html import escape

from harness.report.content import (
    SYMBOLS,
    Bar,
    CalibrationChapter,
    Cell,
    CurveFigure,
    Document,
    Exhibits,
    ExhibitSection,
    MutantsChapter,
    Picture,
    PictureFigure,
    Remark,
    SceneSection,
    Swatch,
    Table,
)
from harness.report.style import FONT, font_folder

_FONT_NAME = "Report STIX"

_STYLE = """
:root { --ink: #1c1c1c; --soft: #5a5a5a; --rule: #d5d5d5; --paper: #fff; }
* { box-sizing: border-box; }
body { font: 16px/1.5 "Libertinus Serif", "Iowan Old Style", Palatino, Georgia, "Times New Roman", serif;
  color: var(--ink); background: #f2f2ef; margin: 0; }
main { max-width: 68rem; margin: 0 auto; padding: 2.5rem 3rem 4rem; background: var(--paper); }
body { counter-reset: figure table; }
h1 { font-size: 2rem; line-height: 1.15; margin: 0; } h2 { margin: 3rem 0 .5rem; border-top: 2px solid var(--ink);
  padding-top: .6rem; } h3 { margin: 1.8rem 0 .4rem; }
.subtitle, .facts { color: var(--soft); } .facts { font-size: .9rem; }
.facts span:not(:last-child)::after { content: " · "; }
nav { font-size: .95rem; margin: 1rem 0; } nav a { margin-right: 1rem; }
a { color: #14508c; text-decoration: none; } a:hover { text-decoration: underline; }
ul.remarks { list-style: none; padding: 0; } ul.remarks li { padding-left: 1.6rem; position: relative; }
ul.remarks .mark { position: absolute; left: 0; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; border-bottom: 1px solid var(--ink); width: 100%;
  font-size: .82rem; font-variant-numeric: tabular-nums lining-nums; }
th, td { padding: .22rem .5rem; text-align: left; vertical-align: top; white-space: nowrap; }
th { border-bottom: 1px solid var(--ink); vertical-align: bottom; white-space: pre; line-height: 1.2; }
td.wide { white-space: normal; }
tr.rule td { border-top: 1px solid var(--rule); }
.right { text-align: right; } .center { text-align: center; }
figure { margin: 1.4rem 0; } figcaption { font-size: .85rem; color: var(--soft); margin: .5rem 0; }
figcaption::before { font-weight: bold; counter-increment: figure; content: "Figure " counter(figure) ". "; }
.table figcaption::before { counter-increment: table; content: "Table " counter(table) ". "; }
.mark { font-family: "DejaVu Sans", "Segoe UI Symbol", "Apple Symbols", sans-serif; font-weight: bold; }
.pass { color: #1b6e3c; } .fail { color: #a8201a; font-weight: bold; } .inconclusive { color: #8a5a00; }
.warning { color: #7a4a8c; } .exact { color: #1f5a8a; }
.swatch { font-family: "DejaVu Sans", sans-serif; margin-right: .35em; font-size: .8em; }
.pictures { display: grid; gap: .6rem; margin: .3rem 0 .8rem; } .pictures p { margin: 0 0 .2rem; font-size: .85rem; }
.pictures img { width: 100%; display: block; image-rendering: pixelated; }
.pictures > div > img { outline: 1px solid var(--rule); }
.rowhead { display: flex; justify-content: space-between; align-items: end; font-size: .9rem; font-weight: bold; }
.bar { font-size: .75rem; font-weight: normal; margin-top: .35rem; } .rowhead .bar { width: 15rem; }
.bar img { width: 100%; height: .5rem; display: block; }
.bar div { display: flex; justify-content: space-between; }
.listing { display: grid; grid-template-columns: 6.5rem 1fr; align-items: baseline; font-size: .85rem; }
.listing pre { margin: .15rem 0; padding: .3rem .6rem; background: #f5f4f0; white-space: pre-wrap;
  font: .82rem/1.45 "DejaVu Sans Mono", Menlo, Consolas, monospace; }
.curves svg { width: 100%; height: auto; }
dt { font-weight: bold; margin-top: .7rem; } dd { margin: 0; }
@media (max-width: 50rem) { main { padding: 1.2rem; } }
@media print { body { background: none; } h2 { break-before: page; } figure { break-inside: avoid; } }
"""

# Cells with more letters than this may break their lines; numbers never do.
_LONG_CELL = 40


def html_page(document: Document) -> str:
    """One HTML file that holds its images (PNG data) and figures (inline SVG) and needs nothing else."""
    assets = document.assets
    links = "".join(f'<a href="#{scene.anchor}">{escape(scene.name)}</a>' for scene in document.scenes)
    if document.exhibits:
        links += f'<a href="#{document.exhibits.anchor}">{escape(document.exhibits.title)}</a>'
    if document.calibration:
        links += f'<a href="#{document.calibration.anchor}">{escape(document.calibration.title)}</a>'
    if document.mutants:
        links += f'<a href="#{document.mutants.anchor}">{escape(document.mutants.title)}</a>'
    reading = "".join(f"<dt>{escape(term)}</dt><dd>{_text(text)}</dd>" for term, text in document.reading)
    parts = [
        f"<h1>{escape(document.title)}</h1>",
        f'<p class="subtitle">{escape(document.subtitle)} · {escape(document.date)}</p>',
        f"<nav>{links}<a href='#reading'>How to read this</a><a href='#provenance'>Provenance</a></nav>",
        _remarks(document.summary), _table(document.verdicts),
        f'<h2 id="reading">How to read this</h2><dl>{reading}</dl>',
        *(_scene(scene, assets) for scene in document.scenes),
        _exhibits(document.exhibits, assets) if document.exhibits else "",
        _calibration(document.calibration, assets) if document.calibration else "",
        _mutants(document.mutants) if document.mutants else "",
        f"<h2>Speed</h2>{_table(document.speed)}" if document.speed else "",
        '<h2 id="provenance">Provenance</h2>', *(_table(table) for table in document.provenance)]
    return (f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f"<title>{escape(document.title)}</title>\n<style>{_font_face(document)}{_STYLE}</style>\n</head>\n<body>\n<main>\n"
            + "\n".join(part for part in parts if part) + "\n</main>\n</body>\n</html>\n")


def _font_face(document: Document) -> str:
    """The figures' font, cut down to the letters that they use: their layout was measured with it.

    The STIX fonts' licence (SIL OFL 1.1) permits embedding; the renamed family keeps an installed one apart.
    """
    from fontTools import subset  # type: ignore[import-untyped]  # matplotlib itself requires it
    from fontTools.ttLib import TTFont  # type: ignore[import-untyped]

    letters = set().union(*(assets.decode() for name, assets in document.assets.items() if name.endswith(".svg")))
    options = subset.Options(layout_features=[], hinting=False, notdef_outline=True)
    font = TTFont(font_folder() / f"{FONT}.ttf")
    options.drop_tables += ["FFTM"]  # a font editor's time stamps
    cutter = subset.Subsetter(options)
    cutter.populate(unicodes=[ord(letter) for letter in letters])
    cutter.subset(font)
    buffer = io.BytesIO()
    font.flavor = "woff"
    font.save(buffer)
    source = f"data:font/woff;base64,{base64.b64encode(buffer.getvalue()).decode()}"
    return f'@font-face {{ font-family: "{_FONT_NAME}"; src: url({source}) format("woff"); }}\n'


def _scene(scene: SceneSection, assets: dict[str, bytes]) -> str:
    facts = "".join(f"<span>{_text(fact)}</span>" for fact in scene.facts)
    return "\n".join((
        f'<h2 id="{scene.anchor}">{escape(scene.name)}</h2>', *(f"<p>{_text(p)}</p>" for p in scene.description),
        f'<p class="facts">{facts}</p>', _remarks(scene.remarks), _pictures(scene.images, assets),
        _curves(scene.curves, assets, scene.anchor), _table(scene.accuracy), "<h3>The verdicts in words</h3>",
        _remarks(scene.reasons), _table(scene.tiles), _table(scene.cost) if scene.cost else "",
        _pictures(scene.differences, assets) if scene.differences else ""))


def _exhibits(chapter: Exhibits, assets: dict[str, bytes]) -> str:
    return "\n".join((f'<h2 id="{chapter.anchor}">{escape(chapter.title)}</h2>',
                      f"<p>{_text(chapter.introduction)}</p>", _table(chapter.overview),
                      *(_exhibit(section, assets) for section in chapter.sections)))


def _exhibit(section: ExhibitSection, assets: dict[str, bytes]) -> str:
    listings = "".join(f'<div class="listing"><span class="{item.mark}">{escape(item.label)}</span>'
                       f"<pre>{escape(item.text)}</pre></div>" for item in section.listings)
    return "\n".join((
        f'<h3 id="{section.anchor}">{escape(section.title)}</h3>', listings, f"<p>{_text(section.effect)}</p>",
        f"<p><b>Instead.</b> {_text(section.advice)}</p>",
        _pictures(section.pictures, assets) if section.pictures else "",
        _curves(section.curves, assets, section.anchor) if section.curves else "", _table(section.findings)))


def _calibration(chapter: CalibrationChapter, assets: dict[str, bytes]) -> str:
    return "\n".join((f'<h2 id="{chapter.anchor}">{escape(chapter.title)}</h2>',
                      f"<p>{_text(chapter.introduction)}</p>", _remarks(chapter.remarks), _table(chapter.alarms),
                      _curves(chapter.power, assets, chapter.anchor), f"<h3>{escape(chapter.suite.title)}</h3>",
                      f"<p>{_text(chapter.suite.introduction)}</p>", _remarks(chapter.suite.remarks),
                      _table(chapter.suite.gates)))


def _mutants(chapter: MutantsChapter) -> str:
    return "\n".join((f'<h2 id="{chapter.anchor}">{escape(chapter.title)}</h2>',
                      f"<p>{_text(chapter.introduction)}</p>", _remarks(chapter.remarks), _table(chapter.gates),
                      _table(chapter.mutants)))


def _text(text: str) -> str:
    """Escaped text, with verdict symbols coloured."""
    shown = escape(text)
    for mark, symbol in SYMBOLS.items():
        if mark in ("pass", "fail", "warning"):  # the others are ordinary characters
            shown = shown.replace(symbol, f'<span class="mark {mark}">{symbol}</span>')
    return shown


def _mark(mark: str, symbol: str | None) -> str:
    return f'<span class="mark {mark}">{symbol}</span>' if symbol else '<span class="mark">·</span>'


def _remarks(remarks: Iterable[Remark]) -> str:
    items = "".join(f"<li>{_mark(r.mark, SYMBOLS.get(r.mark))}{_text(r.text)}</li>" for r in remarks)
    return f'<ul class="remarks">{items}</ul>' if items else ""


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
            cells.append(_cell(cell, table.columns[column].align, wide=len(cell.text) > _LONG_CELL))
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
    spans = (f' rowspan="{cell.rows}"' if cell.rows > 1 else "") + (
        f' colspan="{cell.columns}"' if cell.columns > 1 else "")
    classes = f"{align}{' wide' if wide else ''}" if cell.columns == 1 else "left"
    return f'<td class="{classes}"{spans}>{_swatch(cell.swatch)}{text}</td>'


def _swatch(swatch: Swatch | None) -> str:
    return f'<span class="swatch" style="color:{swatch.colour}">{swatch.glyph}</span>' if swatch else ""


def _pictures(figure: PictureFigure, assets: dict[str, bytes]) -> str:
    rows = []
    for row in figure.rows:
        if row.title:
            bar = _bar(row.bar, assets) if row.bar else ""
            rows.append(f'<div class="rowhead"><span>{escape(row.title)}</span>{bar}</div>')
        columns = max(len(row.pictures), 4)
        rows.append(f'<div class="pictures" style="grid-template-columns: repeat({columns}, 1fr)">'
                    f"{''.join(_picture(picture, assets) for picture in row.pictures)}</div>")
    return f"<figure>{''.join(rows)}<figcaption>{_text(figure.caption)}</figcaption></figure>"


def _picture(picture: Picture, assets: dict[str, bytes]) -> str:
    title = f"<p>{_swatch(picture.swatch)}{escape(picture.title)}</p>" if picture.title else ""
    bar = _bar(picture.bar, assets) if picture.bar else ""
    return f'<div>{title}<img alt="{escape(picture.alt)}" src="{_png(assets[picture.file])}">{bar}</div>'


def _bar(bar: Bar, assets: dict[str, bytes]) -> str:
    labels = "".join(f"<span>{escape(label)}</span>" for label in bar.labels)
    return f'<div class="bar"><img alt="colour bar" src="{_png(assets[bar.file])}"><div>{labels}</div></div>'


def _png(content: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(content).decode()}"


def _curves(figure: CurveFigure, assets: dict[str, bytes], anchor: str) -> str:
    svg = assets[figure.file].decode()
    svg = svg[svg.index("<svg"):]
    # Several figures share one page, so each needs its own names for clip paths and markers.
    svg = re.sub(r'\bid="', f'id="{anchor}-', svg)
    svg = re.sub(r'(url\(|xlink:href=")#', rf"\g<1>#{anchor}-", svg)
    svg = svg.replace(f"'{FONT}'", f"'{_FONT_NAME}'")
    svg = svg.replace("<svg", f'<svg role="img" aria-label="{escape(figure.alt)}"', 1)
    width = f' style="max-width: {100 * figure.width / 17:.0f}%"' if figure.width < 17 else ""
    return f'<figure class="curves"{width}>{svg}<figcaption>{_text(figure.caption)}</figcaption></figure>'
