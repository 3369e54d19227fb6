"""Plots of an exhibit, side by side in one vector figure: the handout's line against the library's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.report.figures.svg import blank, svg
from harness.results import Plot, Series

_PANEL_CM, _HEIGHT_CM = 17 / 3, 4.6
_SINGLE_CM = 9.0  # a figure of one panel
_OURS, _HANDOUT = ("#0072b2", "o"), ("#d55e00", "v")  # the palette of `style`
# What a caption calls them.
OURS, HANDOUT = "Blue dots", "Orange triangles"


def panels_svg(plots: Sequence[Plot], salt: str) -> tuple[bytes, float]:
    """The figure as SVG, and its width in centimetres; `salt`: see `svg`."""
    width = _SINGLE_CM if len(plots) == 1 else len(plots) * _PANEL_CM
    return svg(lambda: _figure(plots, width), salt, of=list(plots)), width


def _figure(plots: Sequence[Plot], width: float) -> Figure:
    figure = blank(width, _HEIGHT_CM)
    panels = np.atleast_1d(figure.subplots(1, len(plots)))
    figure.subplots_adjust(left=1.05 / width, right=1 - 0.25 / width, bottom=0.19, top=0.88, wspace=0.3)
    for axes, plot in zip(panels, plots, strict=True):
        _panel(axes, plot)
    return figure


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
