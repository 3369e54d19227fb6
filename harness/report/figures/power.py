"""Power curves of the verdicts as a vector figure: what share of comparisons passed, and failed, at each gain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from harness.report.figures.svg import blank, svg
from harness.stats.calibration import Power
from harness.stats.rates import Rate

WIDTH_CM, HEIGHT_CM = 17.0, 5.5
# Of the palette of Okabe and Ito, as in `style`.
_PASSED, _FAILED = "#009e73", "#d55e00"
_CASES = ("#0072b2", "#e69f00", "#cc79a7", "#56b4e9", "#000000")


def power_svg(powers: Sequence[Power]) -> tuple[bytes, list[str]]:
    """The figure as SVG, and the names of the cases without tolerance, in the order of its colours."""
    names = list(dict.fromkeys(each.case for each in powers if each.tolerance == 0))
    return svg(lambda: _panels(powers, names), "calibration", of=list(powers)), names


def _panels(powers: Sequence[Power], names: Sequence[str]) -> Figure:
    figure = blank(WIDTH_CM, HEIGHT_CM)
    panels = figure.subplots(1, 3, sharey=True)
    figure.subplots_adjust(left=0.05, right=0.985, bottom=0.18, top=0.9, wspace=0.1)
    for axes, where, title in ((panels[0], "everywhere", "Gain of everything"),
                               (panels[1], "patch", "Gain in 1 % of the image")):
        _decided(axes, [each for each in powers if each.tolerance > 0 and each.where == where], title)
    _found(panels[2], powers, names)
    return figure


def _decided(axes: Axes, powers: Sequence[Power], title: str) -> None:
    """Passed and failed under a tolerance; what is left between them is undecided."""
    _gain_axis(axes, powers)
    _curve(axes, powers, [Rate(each.passed, each.trials) for each in powers], _PASSED, "o", "passed")
    _curve(axes, powers, [Rate(each.failed, each.trials) for each in powers], _FAILED, "s", "failed")
    axes.axvline(powers[0].tolerance, color="#888888", linewidth=0.7, linestyle=":")
    axes.legend(loc="center right", frameon=False)
    axes.set_title(title, loc="left")


def _found(axes: Axes, powers: Sequence[Power], names: Sequence[str]) -> None:
    """Found without a tolerance, one colour a case."""
    _gain_axis(axes, [each for each in powers if each.tolerance == 0])
    for name, colour in zip(names, _CASES, strict=False):
        for where, marker in (("everywhere", "o"), ("patch", "")):
            mine = [each for each in powers if each.case == name and each.where == where]
            _curve(axes, mine, [Rate(each.failed, each.trials) for each in mine], colour, marker,
                   name.partition(":")[0] if where == "everywhere" else "")
    axes.legend(loc="center left", frameon=False, handlelength=1.0)
    axes.set_title("Found without tolerance", loc="left")


def _curve(axes: Axes, powers: Sequence[Power], rates: Sequence[Rate], colour: str, marker: str, label: str) -> None:
    """Shares with their binomial band; dashed without a marker. A gain of zero has no place on a log axis."""
    shown = [(each.gain, rate) for each, rate in zip(powers, rates, strict=True) if each.gain > 0]
    gains = [gain for gain, _ in shown]
    low, high = np.array([rate.interval() for _, rate in shown]).T
    axes.fill_between(gains, low, high, color=colour, alpha=0.15, linewidth=0)
    axes.plot(gains, [rate.value for _, rate in shown], color=colour, marker=marker,
              linestyle="-" if marker else (0, (3, 2)), label=label or "_dashed")


def _gain_axis(axes: Axes, powers: Sequence[Power]) -> None:
    gains = sorted({each.gain for each in powers if each.gain > 0})
    axes.set_xscale("log")
    axes.set_xlim(gains[0] * 0.85, gains[-1] * 1.15)
    axes.set_ylim(-0.03, 1.03)
    ticks = [tick for k in range(-4, 1) for m in (1, 2, 5) if gains[0] <= (tick := float(f"{m}e{k}")) <= gains[-1]]
    axes.xaxis.set_major_locator(FixedLocator(ticks[:: -(-len(ticks) // 6)]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{100 * x:g} %"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_locator(FixedLocator([0, 0.25, 0.5, 0.75, 1]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    axes.set_xlabel("gain", labelpad=2)
