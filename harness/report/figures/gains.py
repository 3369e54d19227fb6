"""What each strategy and sampler saves at equal error, a row a scene, as one vector figure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from harness.report.figures.style import GUIDE_COLOUR, strategy_style
from harness.report.figures.svg import blank, svg
from harness.studies import EVEN
from harness.studies.equal_error import Cost, EqualError

WIDTH_CM, ROW_CM = 17.0, 0.62
LEGEND_COLUMNS = 6
_HEAD_CM, _FOOT_CM, _LEGEND_ROW_CM = 0.25, 1.05, 0.42
# Marks of one row stand above each other, over this part of it.
_SPREAD = 0.62

Row = tuple[str, EqualError]


def gains_svg(rows: Sequence[Row]) -> bytes:
    """The figure as SVG, of one scene or more, the first on top."""
    return svg(lambda: _figure(rows), "gains", of=[(scene, *map(_plain, equal.costs)) for scene, equal in rows])


def _plain(cost: Cost) -> list[object]:
    gain = cost.time_gain
    return [cost.strategy.strategy, *((gain.value, gain.low, gain.high) if gain else ())]


def _figure(rows: Sequence[Row]) -> Figure:
    names = list(dict.fromkeys(cost.strategy.strategy for _, equal in rows for cost in equal.costs))
    legend = -(-len(names) // LEGEND_COLUMNS) * _LEGEND_ROW_CM + _HEAD_CM
    height = len(rows) * ROW_CM + legend + _FOOT_CM
    figure = blank(WIDTH_CM, height)
    axes = figure.subplots()
    figure.subplots_adjust(left=0.17, right=0.985, bottom=_FOOT_CM / height, top=1 - legend / height)
    axes.set_xscale("log")
    for place, (_, equal) in enumerate(rows):
        _row(axes, place, equal)
    axes.axvline(1, color="#888888", linewidth=0.7)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_yticks(range(len(rows)), [scene for scene, _ in rows])
    axes.tick_params(axis="y", length=0)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if _decades(axes) < 2.5 else (1.0,)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g} ×"))
    axes.set_xlabel("times sooner than the baseline", labelpad=2)
    figure.legend(handles=[_handle(name) for name in names], loc="upper left", bbox_to_anchor=(0.16, 1.0),
                  ncols=LEGEND_COLUMNS, frameon=False, columnspacing=1.2, handletextpad=0.2, borderaxespad=0.2)
    return figure


def _decades(axes: Axes) -> float:
    low, high = axes.get_xlim()
    return float(np.log10(high / low))


def _row(axes: Axes, place: int, equal: EqualError) -> None:
    """One scene's marks with their intervals, over a faint line to the next."""
    axes.axhline(place + 0.5, color=GUIDE_COLOUR, linewidth=0.3)
    for index, cost in enumerate(equal.costs):
        y = place + _SPREAD * ((index + 0.5) / len(equal.costs) - 0.5)
        gain = cost.time_gain
        value = gain.value if gain else 1.0
        if not np.isfinite(value):
            continue
        style = strategy_style(cost.strategy.strategy)
        if gain and np.isfinite([gain.low, gain.high]).all() and gain.low > 0:
            axes.plot([gain.low, gain.high], [y, y], color=style.colour, linewidth=0.8)
        axes.plot(value, y, color=style.colour, marker=style.marker, linestyle="none",
                  markerfacecolor=_face(cost.strategy.strategy), markersize=3.8, markeredgewidth=0.8)


def _face(name: str) -> str:
    """Hollow where numbers are spread evenly."""
    return "white" if name.endswith(f" {EVEN}") else strategy_style(name).colour


def _handle(name: str) -> Line2D:
    style = strategy_style(name)
    return Line2D([], [], color=style.colour, marker=style.marker, linestyle="none", label=name, markersize=3.8,
                  markerfacecolor=_face(name), markeredgewidth=0.8)
