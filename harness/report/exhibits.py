"""The chapter on the handout's errors: formula, effect, pictures and the checks that find each."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from harness.report import formats, pictures
from harness.report.content import (
    Bar,
    Cell,
    Column,
    CurveFigure,
    Exhibits,
    ExhibitSection,
    Listing,
    Picture,
    PictureFigure,
    PictureRow,
    Table,
)
from harness.report.sections import DIFFERENCE_BAR, Assets
from harness.report.style import RC
from harness.results import Exhibit, ExhibitImage, Finding, Plot, Series

TITLE, ANCHOR = "The handout's errors", "exhibits"
_CM = 1 / 2.54
_PANEL_CM, _HEIGHT_CM = 17 / 3, 4.6
_SINGLE_CM = 9.0  # a figure of one panel
_OURS, _HANDOUT = ("#0072b2", "o"), ("#d55e00", "v")  # the palette of report.style
_FINEST = {"relative": 1e-3, "deviations": 1.0}
_CLIPS = {"relative": 0.5, "deviations": 3.0}  # beyond these, a map's colours saturate


def exhibits_chapter(exhibits: Sequence[Exhibit]) -> tuple[Exhibits | None, Assets]:
    """The chapter and its PNG and SVG files; None where nothing was measured."""
    if not exhibits:
        return None, {}
    assets: Assets = {}
    sections = tuple(_section(exhibit, assets) for exhibit in exhibits)
    checks = sorted({finding.check for exhibit in exhibits for finding in exhibit.findings if finding.caught})
    introduction = (
        "The course handout that this path tracer comes from holds, or leaves room for, "
        f"{formats.plural(len(exhibits), 'error')}. Its formulas were put, word for word, in the place of the "
        "library's own functions, and run. Here is what each does to the numbers and to the picture, which check finds "
        "it, and what to write instead. Every check is run on the library's functions as well, and must pass them. The "
        f"checks: {formats.words(checks)}.")
    return Exhibits(TITLE, ANCHOR, introduction, _overview(exhibits), sections), assets


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


def _section(exhibit: Exhibit, assets: Assets) -> ExhibitSection:
    listings = [Listing("Handout", exhibit.handout, "fail")]
    if exhibit.message:
        listings.append(Listing("Compiler", exhibit.message, "warning"))
    listings.append(Listing("Right", exhibit.right, "pass"))
    return ExhibitSection(
        exhibit.title, _anchor(exhibit), tuple(listings), formats.typographic(exhibit.effect), exhibit.advice,
        _picture_figure(exhibit, assets) if exhibit.images else None,
        _curve_figure(exhibit, assets) if exhibit.plots else None, _findings(exhibit))


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


def _picture_figure(exhibit: Exhibit, assets: Assets) -> PictureFigure:
    """Renders first; maps beside them where there is one, else in a row of their own, on one scale."""
    maps = [image for image in exhibit.images if image.unit != "radiance"]
    scale = 1.0
    if maps:
        unit = maps[0].unit
        scale = min(pictures.robust_limit([image.image for image in maps], _FINEST[unit]), _CLIPS[unit])
    shown = [_picture(f"{_anchor(exhibit)}-{index}.png", image, scale, assets, shared=len(maps) > 1)
             for index, image in enumerate(exhibit.images)]
    renders, others = shown[:len(shown) - len(maps)], shown[len(shown) - len(maps):]
    if len(maps) == 1:
        rows = [PictureRow((*renders, *others))]
    else:
        rows = [PictureRow(tuple(renders))] if renders else []
        if maps:
            title = "Relative difference from Mitsuba" if maps[0].unit == "relative" else "Noise"
            rows.append(PictureRow(tuple(others), title, _bar(maps[0], scale)))
    return PictureFigure(_picture_caption(exhibit, maps), tuple(rows))


def _picture_caption(exhibit: Exhibit, maps: Sequence[ExhibitImage]) -> str:
    told = {"relative": "relative differences in luminance from Mitsuba, blue where it is darker, red where brighter",
            "deviations": "noise, in standard deviations of each pixel"}
    renders = any(image.unit == "radiance" for image in exhibit.images)
    parts = [*(["as displayed"] if renders else []), *([told[maps[0].unit]] if maps else [])]
    return f"{exhibit.title}: {', and '.join(parts)}."


def _picture(file: str, image: ExhibitImage, scale: float, assets: Assets, *, shared: bool) -> Picture:
    if image.unit == "radiance":
        assets[file] = pictures.display_png(image.image, 0.0)
        return Picture(file, image.title, image.title)
    assets[file] = pictures.difference_png(image.image, scale)
    return Picture(file, image.title, image.title, None if shared else _bar(image, scale))


def _bar(image: ExhibitImage, scale: float) -> Bar:
    size = f"{100 * scale:g}{formats.NBSP}%" if image.unit == "relative" else f"{scale:g}{formats.NBSP}σ"
    return Bar(DIFFERENCE_BAR, (f"{formats.MINUS}{size}", "0", f"+{size}"))


def _curve_figure(exhibit: Exhibit, assets: Assets) -> CurveFigure:
    file = f"{_anchor(exhibit)}-curves.svg"
    count = len(exhibit.plots)
    width = _SINGLE_CM if count == 1 else count * _PANEL_CM
    settings: Any = {**RC, "svg.hashsalt": exhibit.id}
    with matplotlib.rc_context(settings):
        figure = Figure(figsize=(width * _CM, _HEIGHT_CM * _CM))
        FigureCanvasSVG(figure)
        panels = np.atleast_1d(figure.subplots(1, count))
        figure.subplots_adjust(left=1.05 / width, right=1 - 0.25 / width, bottom=0.19, top=0.88, wspace=0.3)
        for axes, plot in zip(panels, exhibit.plots, strict=True):
            _panel(axes, plot)
        buffer = io.BytesIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    assets[file] = buffer.getvalue()
    titles = formats.words([plot.title for plot in exhibit.plots])
    return CurveFigure(f"{exhibit.title}. {_key(exhibit.plots)}", file, titles, width)


def _key(plots: Sequence[Plot]) -> str:
    """Which line is whose; the names are those of the plots."""
    names = dict.fromkeys((series.ours, series.name) for plot in plots for series in plot.series)
    return " ".join(f"{'Blue dots' if ours else 'Orange triangles'}: {name}." for ours, name in sorted(names))


def _panel(axes: Axes, plot: Plot) -> None:
    """One plot."""
    if "x" in plot.log:
        axes.set_xscale("log")
    if "y" in plot.log:
        axes.set_yscale("log")
    for series in plot.series:
        _draw(axes, series)
    axes.set_xlabel(plot.x_label, labelpad=2)
    axes.set_title(plot.title, loc="left")


def _draw(axes: Axes, series: Series) -> None:
    colour, marker = _OURS if series.ours else _HANDOUT
    finite = np.isfinite(series.y)
    axes.plot(series.x[finite], series.y[finite], color=colour, marker=marker, label=series.name,
              markersize=2.2 if len(series.x) > 20 else 3.2, linewidth=0.9)
