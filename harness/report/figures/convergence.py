"""Convergence curves as vector figures: RMSE, mean error and SSIM against samples per pixel, text kept as text."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from harness.report.figures.style import GUIDE_COLOUR, TOLERANCE_COLOUR, strategy_style
from harness.report.figures.svg import blank, svg
from harness.report.formats import MINUS, number
from harness.results import StrategyResult, StudyResult
from harness.stats.convergence import band

WIDTH_CM, HEIGHT_CM = 17.0, 7.2  # the page's text width; the figure is printed at its own size

LEGEND_COLUMNS = 3
LEGEND_ROW_CM = 0.45
_FINE_SLOPE = 0.001  # half widths below this have a fourth decimal
_MIN_TICKS, _MAX_TICKS = 3, 6
# Merged estimates of several strategies share one number of samples: their error bars stand side by side.
_DODGE = 1.12
# The rate of independent samples; those of samples that are spread evenly, and how they are drawn.
EXPECTED_SLOPE = -0.5
_GUIDE_LINES: dict[float, tuple[float, tuple[float, float]]] = {-0.75: (0, (4, 2)), -1.0: (0, (1, 1.5))}
_GUIDE_WORDS = {-0.75: f"slope {MINUS}3/4, of edges", -1.0: f"slope {MINUS}1, of smooth pixels"}


def curves_svg(result: StudyResult) -> bytes:
    """`curves` as SVG, its text in text elements; the same bytes for the same result."""
    return svg(lambda: curves(result), result.scene, of=result)


def curves(result: StudyResult) -> Figure:
    """The three convergence panels of one scene, 17 cm wide; to be called with the report's settings in force.

    Bands are Student confidence intervals over the replicas, at the confidence of the scene's verdicts; error bars
    in the middle panel are the verdict's own interval, of the estimate that merges all replicas.
    """
    handles = _legend_handles(result)
    more = max(0, math.ceil(len(handles) / LEGEND_COLUMNS) - 2) * LEGEND_ROW_CM  # than the two rows that most have
    height = HEIGHT_CM + more
    figure = blank(WIDTH_CM, height)
    panels = figure.subplots(1, 3)
    figure.subplots_adjust(left=0.055, right=0.985, bottom=0.13 * HEIGHT_CM / height,
                           top=1 - (0.22 * HEIGHT_CM + more) / height, wspace=0.27)
    _rmse_panel(panels[0], result)
    _mean_error_panel(panels[1], result)
    _ssim_panel(panels[2], result)
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.0, 1.0), ncols=LEGEND_COLUMNS,
                  frameon=False, handlelength=2.2, columnspacing=1.6, handletextpad=0.5, borderaxespad=0.2)
    return figure


def _rmse_panel(axes: Axes, result: StudyResult) -> None:
    """RMSE on log-log axes over grey diagonals of slope -1/2, and of the others that are expected, each from where a
    curve begins."""
    _spp_axis(axes, result)
    axes.set_yscale("log")
    _draw_bands(axes, result, lambda strategy: strategy.curves["rmse"], log=True)
    _slope_guides(axes)
    for strategy in result.strategies:
        _expected_guides(axes, strategy)
    axes.yaxis.set_major_locator(FixedLocator(_log_ticks(*axes.get_ylim())))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_title("RMSE (radiance)", loc="left")


def _mean_error_panel(axes: Axes, result: StudyResult) -> None:
    """Signed mean error in percent: linear inside the tolerance, logarithmic outside."""
    tolerance = 100 * max(strategy.verdict.tolerance for strategy in result.strategies)
    _spp_axis(axes, result, merged=True)
    axes.set_yscale("symlog", linthresh=tolerance, linscale=1.0)
    axes.axhspan(-tolerance, tolerance, color=TOLERANCE_COLOUR, linewidth=0, zorder=0)
    axes.axhline(0, color="#888888", linewidth=0.5, zorder=1)
    _draw_bands(axes, result, lambda strategy: 100 * strategy.curves["mean_error"], log=False)
    middle = (len(result.strategies) - 1) / 2
    for index, strategy in enumerate(result.strategies):
        value, low, high = (100 * bound for bound in strategy.verdict.luminance)
        style = strategy_style(strategy.strategy)
        x = max(strategy.estimate.samples, 1) * _DODGE ** (2 * (index - middle))
        if np.isfinite([low, high]).all():
            bar = axes.errorbar(x, value, [[max(value - low, 0)], [max(high - value, 0)]], color=style.colour,
                                marker=style.marker, capsize=1.6, capthick=0.7, elinewidth=0.9, zorder=4)
            bar.lines[0].set_label(f"{strategy.strategy}, all replicas")
            bar.lines[0].set_gid(number(strategy.estimate.samples, 0))
    limit = max(abs(bound) for bound in axes.get_ylim())
    limit = max(limit, 2 * tolerance)
    axes.set_ylim(-limit, limit)
    decades = 10.0 ** np.arange(np.ceil(np.log10(tolerance * 1.5)), np.floor(np.log10(limit)) + 1)
    step = int(np.ceil(len(decades) / 2)) or 1
    positive = [tolerance, *decades[::-1][::step]]
    axes.yaxis.set_major_locator(FixedLocator([-p for p in positive] + [0] + positive))
    axes.yaxis.set_major_formatter(FuncFormatter(_percent_tick))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_title("Mean error of luminance", loc="left")


def _ssim_panel(axes: Axes, result: StudyResult) -> None:
    """SSIM with 1 - SSIM on a log axis turned upside down: every nine gained is one step up."""
    _spp_axis(axes, result)
    axes.set_yscale("log")
    _draw_bands(axes, result, lambda strategy: 1 - strategy.curves["ssim"], log=True)
    axes.invert_yaxis()
    low, high = sorted(axes.get_ylim())
    axes.set_ylim(min(high, 1.5), low)
    axes.yaxis.set_major_locator(FixedLocator(_log_ticks(low, min(high, 1.0))))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{1 - y:.6g}"))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_title("SSIM", loc="left")


def _draw_bands(axes: Axes, result: StudyResult, values: Callable[[StrategyResult], np.ndarray], *,
                log: bool) -> None:
    """One line with its confidence band for each strategy; on log axes what is not positive is left out."""
    for strategy in result.strategies:
        style = strategy_style(strategy.strategy)
        mean, low, high = band(values(strategy), strategy.verdict.confidence, geometric=log)
        shown = np.isfinite(mean) & ((mean > 0) if log else True)
        if not shown.any():
            continue
        spp = strategy.spp[shown]
        banded = np.isfinite(low[shown]) & np.isfinite(high[shown])
        axes.fill_between(spp[banded], low[shown][banded], high[shown][banded], color=style.colour, alpha=0.18,
                          linewidth=0, zorder=2)
        axes.plot(spp, mean[shown], color=style.colour, marker=style.marker, zorder=3, label=strategy.strategy,
                  **_line(strategy))
    if not axes.has_data():
        axes.text(0.5, 0.5, "nothing to draw on a log axis" if log else "no finite value", ha="center", va="center",
                  transform=axes.transAxes, color="#777777")


def _line(strategy: StrategyResult) -> dict[str, Any]:
    """Dashed, with hollow markers, where the strategy does not suit the scene; dotted where samples are spread
    evenly."""
    if not strategy.suits:
        return {"linestyle": (0, (3, 2)), "markerfacecolor": "white"}
    return {} if min(strategy.expected) >= EXPECTED_SLOPE else {"linestyle": (0, (1, 1.2))}


def _spp_axis(axes: Axes, result: StudyResult, *, merged: bool = False) -> None:
    """A logarithmic axis of samples per pixel with a few powers of two written out; `merged`: up to all replicas'."""
    axes.set_xscale("log", base=2)
    spp = np.concatenate([strategy.spp for strategy in result.strategies]
                         + [[max(s.estimate.samples, 1) for s in result.strategies] if merged else []])
    first, last = int(np.floor(np.log2(spp.min()))), int(np.ceil(np.log2(spp.max())))
    step = max(1, -(-(last - first) // (_MAX_TICKS - 1)))
    axes.xaxis.set_major_locator(FixedLocator([2.0**k for k in range(first, last + 1, step)]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: number(x, 0)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("samples per pixel", labelpad=2)


def _slope_guides(axes: Axes) -> None:
    """Faint diagonals of slope -1/2, a factor 10^(1/2) apart, over the whole panel."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    x = np.array([left, right])
    first, last = np.log10(bottom) + 0.5 * np.log10(left), np.log10(top) + 0.5 * np.log10(right)
    for exponent in np.arange(np.ceil(2 * first) / 2, last, 0.5):
        axes.plot(x, 10**exponent * x**-0.5, color=GUIDE_COLOUR, linewidth=0.4, zorder=0)
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)


def _expected_guides(axes: Axes, strategy: StrategyResult) -> None:
    """Other slopes than -1/2 that a strategy may show, drawn from the first point of its curve."""
    steeper = [slope for slope in strategy.expected if slope != EXPECTED_SLOPE]
    mean = band(strategy.curves["rmse"], strategy.verdict.confidence, geometric=True)[0]
    if not steeper or not np.isfinite(mean[0]):
        return
    limits = axes.get_xlim(), axes.get_ylim()
    spp = strategy.spp.astype(float)
    for slope in steeper:
        axes.plot(spp, mean[0] * (spp / spp[0]) ** slope, color=GUIDE_COLOUR, linewidth=0.6, zorder=0,
                  linestyle=_GUIDE_LINES[slope])
    axes.set_xlim(limits[0])
    axes.set_ylim(limits[1])


def _log_ticks(low: float, high: float) -> list[float]:
    """Values to label on a log axis: decades, with halves and fifths between where few decades are in view."""
    exponents = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    decades = [float(f"1e{k}") for k in exponents if low <= 10.0**k <= high]
    if len(decades) >= _MIN_TICKS:
        return decades[:: -(-len(decades) // _MAX_TICKS)]
    return [tick for k in exponents for m in (1, 2, 5) if low <= (tick := float(f"{m}e{k}")) <= high]


def _percent_tick(value: float, _: object = None) -> str:
    sign = "" if value == 0 else "+" if value > 0 else MINUS
    return f"{sign}{abs(value):g} %"


def _slope_words(strategy: StrategyResult) -> str:
    slope = strategy.slope
    if slope is None:
        return "no slope"
    if not np.isfinite(slope.low):
        return f"slope {number(slope.slope, 3)}"
    half = (slope.high - slope.low) / 2
    return f"slope {number(slope.slope, 3)} ± {number(half, 3 if half >= _FINE_SLOPE else 4)}"


def _legend_handles(result: StudyResult) -> list[Line2D]:
    handles = []
    for strategy in result.strategies:
        style = strategy_style(strategy.strategy)
        remark = "" if strategy.suits else " (not suited)"
        handles.append(Line2D([], [], color=style.colour, marker=style.marker,
                              label=f"{strategy.strategy}{remark}: {_slope_words(strategy)}", **_line(strategy)))
    handles.append(Line2D([], [], color=GUIDE_COLOUR, linewidth=0.8, label=f"slope {MINUS}1/2"))
    others = {slope for strategy in result.strategies for slope in strategy.expected} - {EXPECTED_SLOPE}
    handles += [Line2D([], [], color=GUIDE_COLOUR, linewidth=0.8, linestyle=_GUIDE_LINES[slope],
                       label=_GUIDE_WORDS[slope]) for slope in sorted(others, reverse=True)]
    return handles
