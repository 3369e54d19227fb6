"""The chapter on the handout's errors: formula, effect, pictures and the checks that find each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from harness.report import formats
from harness.report.bars import signed_bar
from harness.report.blocks import (
    Asset,
    Bar,
    Block,
    Cell,
    Chapter,
    Column,
    Curves,
    Heading,
    Listing,
    Listings,
    Paragraph,
    Picture,
    PictureRow,
    Pictures,
    Table,
)
from harness.report.figures import pictures
from harness.report.inputs import Inputs
from harness.report.remembered import remembered_chapters
from harness.results import Exhibit, ExhibitImage, Finding, Plot

PLACE = 30
TITLE, ANCHOR = "The handout's errors", "exhibits"
_FINEST = {"relative": 1e-3, "deviations": 1.0}
_CLIPS = {"relative": 0.5, "deviations": 3.0}  # beyond these, a map's colours saturate


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, where exhibits were measured: an overview, and a section an error."""
    if inputs.exhibits:
        yield from remembered_chapters(partial(_chapters, inputs.exhibits), __name__, inputs.exhibits)


def _chapters(exhibits: Sequence[Exhibit]) -> Iterator[Chapter]:
    sections = (block for exhibit in exhibits for block in _section(exhibit))
    yield Chapter(TITLE, ANCHOR, (Paragraph(_introduction(exhibits)), _overview(exhibits), *sections))


def _introduction(exhibits: Sequence[Exhibit]) -> str:
    checks = sorted({finding.check for exhibit in exhibits for finding in exhibit.findings if finding.caught})
    return (
        "The course handout that this path tracer comes from holds, or leaves room for, "
        f"{formats.plural(len(exhibits), 'error')}. Its formulas were put, word for word, in the place of the "
        "library's own functions, and run. Here is what each does to the numbers and to the picture, which check finds "
        "it, and what to write instead. Every check is run on the library's functions as well, and must pass them. The "
        f"checks: {formats.words(checks)}.")


def _overview(exhibits: Sequence[Exhibit]) -> Table:
    rows = []
    for exhibit in exhibits:
        caught = list(dict.fromkeys(finding.check for finding in exhibit.findings if finding.caught))
        missed = list(dict.fromkeys(finding.check for finding in exhibit.findings
                                    if not finding.caught and finding.check not in caught))
        cleared = all(finding.cleared for finding in exhibit.findings)
        rows.append((Cell(exhibit.title, target=_anchor(exhibit)), Cell(formats.typographic(exhibit.size)),
                     Cell(", ".join(caught)), Cell(", ".join(missed) or formats.MISSING),
                     Cell("pass" if cleared else "fail", "pass" if cleared else "fail")))
    return Table("The handout's errors, what finds them and what does not. Ours: the same checks on the library's own "
                 "functions.",
                 (Column("Error", share=1), Column("Size", share=1), Column("Found by", share=1), Column("Not by"),
                  Column("Ours")), tuple(rows))


def _anchor(exhibit: Exhibit) -> str:
    return f"exhibit-{exhibit.id}"


def _section(exhibit: Exhibit) -> Iterator[Block]:
    yield Heading(exhibit.title, _anchor(exhibit))
    listings = [Listing("Handout", exhibit.handout, "fail")]
    if exhibit.message:
        listings.append(Listing("Compiler", exhibit.message, "warning"))
    yield Listings((*listings, Listing("Right", exhibit.right, "pass")))
    yield Paragraph(formats.typographic(exhibit.effect))
    yield Paragraph(exhibit.advice, lead="Instead.")
    if exhibit.images:
        yield _pictures(exhibit)
    if exhibit.plots:
        yield _curves(exhibit)
    yield _findings(exhibit)


def _findings(exhibit: Exhibit) -> Table:
    rows, rules, last = [], [], ""
    for index, finding in enumerate(exhibit.findings):
        subject = finding.measures.partition(":")[0]
        if index == 0 or (":" in finding.measures and subject != last):
            rules.append(index)
        last = subject
        rows.append((Cell(finding.check), Cell(formats.typographic(finding.measures)),
                     Cell(_value(finding, finding.handout), "fail" if finding.caught else ""),
                     Cell(_value(finding, finding.ours), "pass" if finding.cleared else "fail")))
    source = f" The handout's text: glsl/{exhibit.file}." if exhibit.file else ""
    caption = (f"{exhibit.title}: what each check measures. ✗: the check objects; ✓: it passes; a bare number on the "
               f"handout's side: it does not notice.{source}")
    return Table(caption, (Column("Check"), Column("Measures", share=1), Column("Handout", "right"),
                           Column("Ours", "right")), tuple(rows), tuple(rules))


def _value(finding: Finding, value: float | str) -> str:
    if isinstance(value, str):
        return value
    if finding.unit == "count":
        return formats.count(value)
    if finding.unit == "number":
        return formats.significant(value)
    return formats.percent(value, sign=finding.unit == "error")


def _pictures(exhibit: Exhibit) -> Pictures:
    """Renders first; maps beside them where there is one, else in a row of their own, on one scale."""
    maps = [image for image in exhibit.images if image.unit != "radiance"]
    scale = 1.0
    if maps:
        unit = maps[0].unit
        scale = min(pictures.robust_limit([image.image for image in maps], _FINEST[unit]), _CLIPS[unit])
    shown = [_picture(f"{_anchor(exhibit)}-{index}.png", image, scale, shared=len(maps) > 1)
             for index, image in enumerate(exhibit.images)]
    renders, others = shown[:len(shown) - len(maps)], shown[len(shown) - len(maps):]
    if len(maps) == 1:
        rows = [PictureRow((*renders, *others))]
    else:
        rows = [PictureRow(tuple(renders))] if renders else []
        if maps:
            title = "Relative difference from Mitsuba" if maps[0].unit == "relative" else "Noise"
            rows.append(PictureRow(tuple(others), title, _bar(maps[0], scale)))
    return Pictures(_picture_caption(exhibit, maps), tuple(rows))


def _picture_caption(exhibit: Exhibit, maps: Sequence[ExhibitImage]) -> str:
    told = {"relative": f"relative differences in luminance from Mitsuba, {pictures.DARKER} where it is "
                        f"darker, {pictures.BRIGHTER} where brighter",
            "deviations": "noise, in standard deviations of each pixel"}
    renders = any(image.unit == "radiance" for image in exhibit.images)
    parts = [*(["as displayed"] if renders else []), *([told[maps[0].unit]] if maps else [])]
    return f"{exhibit.title}: {', and '.join(parts)}."


def _picture(file: str, image: ExhibitImage, scale: float, *, shared: bool) -> Picture:
    if image.unit == "radiance":
        return Picture(Asset(file, pictures.display_png(image.image, 0.0)), image.title, image.title)
    shown = Asset(file, pictures.difference_png(image.image, scale))
    return Picture(shown, image.title, image.title, None if shared else _bar(image, scale))


def _bar(image: ExhibitImage, scale: float) -> Bar:
    return signed_bar(formats.share(scale) if image.unit == "relative" else f"{scale:g}{formats.NBSP}σ")


def _curves(exhibit: Exhibit) -> Curves:
    from harness.report.figures.panels import panels_svg

    svg, width = panels_svg(exhibit.plots, exhibit.id)
    titles = formats.words([plot.title for plot in exhibit.plots])
    file = Asset(f"{_anchor(exhibit)}-curves.svg", svg)
    return Curves(f"{exhibit.title}. {_key(exhibit.plots)}", file, titles, width)


def _key(plots: Sequence[Plot]) -> str:
    """Which line is whose; the names are those of the plots."""
    from harness.report.figures.panels import HANDOUT, OURS

    names = dict.fromkeys((series.ours, series.name) for plot in plots for series in plot.series)
    return " ".join(f"{OURS if ours else HANDOUT}: {name}." for ours, name in sorted(names))
