"""Figures of studies over parameters: a panel a study and a line an estimator, or a panel a parameter's row."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from harness.files import write_atomically
from harness.report.figures.style import GUIDE_COLOUR, TOLERANCE_COLOUR, styles
from harness.report.figures.svg import blank, svg
from harness.report.formats import MINUS, significant
from harness.results import StrategyResult, StudyResult
from harness.samples.spent import spent
from harness.scene.strategies import Style
from harness.stats.convergence import band
from harness.stats.efficiency import Factor
from harness.studies.costs import costs_of
from harness.studies.parameters import is_numeric
from harness.studies.product import StudyProduct

WIDTH_CM, PANEL_CM, LEGEND_CM = 17.0, 4.9, 0.45
COLUMNS, LEGEND_COLUMNS = 3, 4
# The rate of independent samples; lines of samples that are spread evenly are dotted.
EXPECTED_SLOPE = -0.5
# Values over so many powers of ten stand on a logarithmic axis.
DECADES = 1.0

Draw = Callable[[Axes, StudyResult, dict[str, Style]], None]


def error_by_samples(product: StudyProduct) -> Figure:
    """RMSE, relative to the reference's mean luminance, against samples per pixel; the grey lines fall as N^(-1/2)."""
    def draw(axes: Axes, study: StudyResult, drawn: dict[str, Style]) -> None:
        _curves(axes, study, drawn, lambda item: item.curves["rmse"] / study.brightness, lambda item: item.spp)
        _error_axes(axes, "samples per pixel", base=2)

    return _panels(product, draw, "RMSE relative to the mean")


def error_by_time(product: StudyProduct) -> Figure:
    """The same against seconds by the clock of the device that drew the samples; who has no clock is left out."""
    def draw(axes: Axes, study: StudyResult, drawn: dict[str, Style]) -> None:
        timed = [item for item in study.strategies if math.isfinite(item.seconds_per_spp)]
        _curves(axes, study, drawn, lambda item: item.curves["rmse"] / study.brightness,
                lambda item: item.spp * item.seconds_per_spp, timed)
        devices = {item.device for item in timed}
        _error_axes(axes, "seconds on its device" if len(devices) > 1 else "seconds", base=10)

    return _panels(product, draw, "RMSE relative to the mean, against time", devices=True)


def ssim_by_samples(product: StudyProduct) -> Figure:
    """SSIM against samples per pixel, on an axis on which every nine gained is one step up."""
    def draw(axes: Axes, study: StudyResult, drawn: dict[str, Style]) -> None:
        _curves(axes, study, drawn, lambda item: 1 - item.curves["ssim"], lambda item: item.spp)
        if not _has_lines(axes):
            return
        axes.set_xscale("log", base=2)
        axes.set_yscale("log")
        axes.invert_yaxis()
        _ticks(axes, "samples per pixel")
        axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{1 - y:.6g}"))

    return _panels(product, draw, "SSIM")


def mean_error_by_samples(product: StudyProduct) -> Figure:
    """Signed error of the mean luminance, in percent: linear within the tolerance, which is shaded, and logarithmic
    outside."""
    def draw(axes: Axes, study: StudyResult, drawn: dict[str, Style]) -> None:
        tolerance = 100 * max(item.verdict.tolerance for item in study.strategies)
        axes.axhspan(-tolerance, tolerance, color=TOLERANCE_COLOUR, linewidth=0, zorder=0)
        axes.axhline(0, color="#888888", linewidth=0.5, zorder=1)
        _curves(axes, study, drawn, lambda item: 100 * item.curves["mean_error"], lambda item: item.spp, log=False)
        axes.set_xscale("log", base=2)
        axes.set_yscale("symlog", linthresh=tolerance)
        limit = max(2 * tolerance, *map(abs, axes.get_ylim()))
        axes.set_ylim(-limit, limit)
        decade = 10.0 ** math.floor(math.log10(limit))
        ticks = [tolerance, *([decade] if decade > 2 * tolerance else [])]
        axes.set_yticks([*(-tick for tick in ticks[::-1]), 0, *ticks])
        _samples_axis(axes, "samples per pixel")
        axes.yaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_major_formatter(FuncFormatter(
            lambda y, _: f"{'' if y == 0 else '+' if y > 0 else MINUS}{abs(y):g} %"))

    return _panels(product, draw, "Mean error of luminance")


def efficiency(product: StudyProduct) -> Figure:
    """Efficiency, 1 / (variance of a sample × its seconds), with its interval; farther right is better."""
    def draw(axes: Axes, study: StudyResult, drawn: dict[str, Style]) -> None:
        found = _efficiencies(study)
        names = list(drawn)
        for name, value in found.items():
            _dot(axes, value, drawn[name], (value.value, names.index(name)), horizontal=True)
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.set_yticks(range(len(names)), [name if name in found else f"{name}: –" for name in names])
        if found:
            axes.set_xscale("log")
            _log_axis(axes.xaxis, decades=1)
        axes.set_xlabel("1 / (radiance² s)", labelpad=2)

    return _panels(product, draw, "Efficiency", wide=True)


def error_by_parameter(product: StudyProduct, name: str) -> Figure:
    """Each estimator's RMSE at the end of its run against a parameter's value, all others fixed.

    ValueError for a parameter whose values are not numbers.
    """
    def value(study: StudyResult, item: StrategyResult) -> Factor:
        mean, low, high = band(item.curves["rmse"][:, -1:] / study.brightness, item.verdict.confidence, geometric=True)
        return Factor(float(mean[0]), float(low[0]), float(high[0]))

    return _by_parameter(product, name, value, "RMSE relative to the mean", percent=True)


def efficiency_by_parameter(product: StudyProduct, name: str) -> Figure:
    """Each estimator's efficiency against a parameter's value. ValueError as above."""
    def value(study: StudyResult, item: StrategyResult) -> Factor:
        return _efficiencies(study).get(item.strategy, Factor(math.nan, math.nan, math.nan))

    return _by_parameter(product, name, value, "Efficiency, 1 / (radiance² s)")


def figures(product: StudyProduct) -> dict[str, Callable[[], Figure]]:
    """Every figure of a product by the name of its file."""
    found: dict[str, Callable[[], Figure]] = {
        "error-by-samples": lambda: error_by_samples(product), "error-by-time": lambda: error_by_time(product),
        "ssim": lambda: ssim_by_samples(product), "mean-error": lambda: mean_error_by_samples(product),
        "efficiency": lambda: efficiency(product)}
    for name in numeric(product):
        plain = re.sub(r"[^A-Za-z0-9_-]", "_", name)
        found[f"error-by-{plain}"] = lambda name=name: error_by_parameter(product, name)  # type: ignore[misc]
        found[f"efficiency-by-{plain}"] = lambda name=name: efficiency_by_parameter(product, name)  # type: ignore[misc]
    return found


def numeric(product: StudyProduct) -> tuple[str, ...]:
    """Parameters that have several values, all of them numbers."""
    return tuple(name for name, values in product.axes if len(values) > 1 and is_numeric(values))


@spent("figures")
def write_figures(product: StudyProduct, folder: Path) -> None:
    """Every figure as SVG into a folder. StoreError where one cannot be written."""
    for name, draw in figures(product).items():
        with write_atomically(folder / f"{name}.svg") as partial:
            partial.write_bytes(svg(draw, name, letters_as_shapes=True))


def _panels(product: StudyProduct, draw: Draw, title: str, *, devices: bool = False, wide: bool = False) -> Figure:
    drawn = styles(item.strategy for study in product.studies for item in study.strategies)
    lines = {item.strategy: item for study in product.studies for item in study.strategies}
    labels = {name: name for name in lines}
    clocks = list(dict.fromkeys(item.device for item in lines.values() if item.device))
    if devices and len(clocks) > 1:  # which says which clock is whose: seconds of two devices have no ratio
        labels = {name: f"{name} [{clocks.index(item.device) + 1}]" if item.device else name
                  for name, item in lines.items()}
        title += " of " + ", ".join(f"[{number}] {clock}" for number, clock in enumerate(clocks, 1))
    figure, panels = _grid(len(product.studies), [_handle(lines[name], drawn[name], labels[name]) for name in lines],
                           title, wide=wide)
    for axes, study in zip(panels, product.studies, strict=True):
        draw(axes, study, drawn)
        axes.set_title(study.scene, loc="left")
    return figure


def _by_parameter(product: StudyProduct, name: str, value: Callable[[StudyResult, StrategyResult], Factor],
                  title: str, *, percent: bool = False) -> Figure:
    if name not in numeric(product):
        raise ValueError(f"parameter '{name}' does not have several values that are numbers; those that have: "
                         f"{', '.join(numeric(product)) or 'none'}")
    groups: dict[str, list[StudyResult]] = {}
    for study in product.studies:
        scene, parameters = study.cell
        others = " ".join([scene, *(f"{other}={given}" for other, given in parameters if other != name)])
        groups.setdefault(others, []).append(study)
    lines = {item.strategy: item for study in product.studies for item in study.strategies}
    drawn = styles(lines)
    figure, panels = _grid(len(groups), [_handle(lines[each], drawn[each], each) for each in lines], title)
    for axes, (others, studies) in zip(panels, groups.items(), strict=True):
        at = sorted(studies, key=lambda study: float(dict(study.cell[1])[name]))
        _against(axes, at, name, value, drawn)
        axes.set_title(others, loc="left")
        axes.set_xlabel(name, labelpad=2)
        if percent:
            axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{100 * y:g} %"))
    return figure


def _against(axes: Axes, studies: Sequence[StudyResult], name: str,
             value: Callable[[StudyResult, StrategyResult], Factor], drawn: dict[str, Style]) -> None:
    for each, style in drawn.items():
        points = [(float(dict(study.cell[1])[name]), value(study, item), item) for study in studies
                  for item in study.strategies if item.strategy == each]
        points = [point for point in points if math.isfinite(point[1].value) and point[1].value > 0]
        if not points:
            continue
        axes.plot([x for x, _, _ in points], [found.value for _, found, _ in points], color=style.colour,
                  marker=style.marker, zorder=3, **_look(points[0][2]))
        for x, found, _ in points:
            _dot(axes, found, style, (x, found.value), horizontal=False)
    values = [float(dict(study.cell[1])[name]) for study in studies]
    if min(values) > 0 and math.log10(max(values) / min(values)) >= DECADES:
        axes.set_xscale("log")
        axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xticks(values if len(values) <= 5 else values[:: -(-len(values) // 5)])
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    if axes.has_data():
        axes.set_yscale("log")
        _log_axis(axes.yaxis)


def _grid(count: int, handles: Sequence[Line2D], title: str, *, wide: bool = False) -> tuple[Figure, list[Axes]]:
    """A figure with so many panels below its title and legend."""
    columns = min(count, COLUMNS - wide)
    rows = -(-count // columns)
    head = 0.75 + LEGEND_CM * -(-len(handles) // LEGEND_COLUMNS)
    height = rows * PANEL_CM + head
    figure = blank(WIDTH_CM, height)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    figure.subplots_adjust(left=0.16 if wide else 0.075, right=0.955 if wide else 0.985, bottom=1.0 / height,
                           top=1 - (head + 0.55) / height, wspace=0.55 if wide else 0.3, hspace=0.55)
    for axes in panels[count:]:
        axes.set_visible(False)
    figure.suptitle(title, x=0.01, y=1 - 0.1 / height, ha="left", va="top", fontsize="medium", fontweight="bold")
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.0, 1 - 0.5 / height), ncols=LEGEND_COLUMNS,
                  frameon=False, handlelength=2.2, columnspacing=1.6, handletextpad=0.5, borderaxespad=0.2)
    return figure, list(panels[:count])


def _curves(axes: Axes, study: StudyResult, drawn: dict[str, Style], values: Callable[[StrategyResult], np.ndarray],
            at: Callable[[StrategyResult], np.ndarray], items: Sequence[StrategyResult] | None = None, *,
            log: bool = True) -> None:
    """A line with its confidence band for each estimator; on log axes what is not positive is left out."""
    for item in study.strategies if items is None else items:
        style = drawn[item.strategy]
        mean, low, high = band(values(item), item.verdict.confidence, geometric=log)
        shown = np.isfinite(mean)
        banded = shown & np.isfinite(low) & np.isfinite(high)
        x = np.asarray(at(item), dtype=float)
        axes.fill_between(x[banded], low[banded], high[banded], color=style.colour, alpha=0.18, linewidth=0, zorder=2)
        if not shown.any():
            continue
        axes.plot(x[shown], mean[shown], color=style.colour, marker=style.marker, zorder=3, **_look(item))
    if not _has_lines(axes):
        axes.set_xticks([])
        axes.set_yticks([])
        axes.text(0.5, 0.5, "nothing to draw", ha="center", va="center", transform=axes.transAxes, color="#777777")


def _error_axes(axes: Axes, label: str, *, base: int) -> None:
    if not _has_lines(axes):
        axes.set_xlabel(label, labelpad=2)
        return
    axes.set_xscale("log", base=base)
    axes.set_yscale("log")
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    x = np.array([left, right])
    first, last = math.log10(bottom) + 0.5 * math.log10(left), math.log10(top) + 0.5 * math.log10(right)
    for exponent in np.arange(math.ceil(2 * first) / 2, last, 0.5):
        axes.plot(x, 10**exponent * x**EXPECTED_SLOPE, color=GUIDE_COLOUR, linewidth=0.4, zorder=0)
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    _ticks(axes, label)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: f"{100 * y:g} %"))


def _has_lines(axes: Axes) -> bool:
    """Whether some line has a point: guides and bands alone are nothing to scale an axis by."""
    return any(len(line.get_xdata(orig=True)) for line in axes.get_lines())  # type: ignore[arg-type]


def _ticks(axes: Axes, label: str) -> None:
    _log_axis(axes.yaxis)
    if label.startswith("seconds"):
        axes.xaxis.set_major_locator(LogLocator(numticks=5))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axes.set_xlabel(label, labelpad=2)
    else:
        _samples_axis(axes, label)


def _samples_axis(axes: Axes, label: str) -> None:
    axes.xaxis.set_major_locator(LogLocator(base=2, numticks=6))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.set_xlabel(label, labelpad=2)


def _log_axis(axis: Any, *, decades: float = 2) -> None:
    """A few values written out: decades, and 2 and 5 between where there are fewer than so many of them."""
    low, high = sorted(axis.get_view_interval())
    few = math.log10(high / low) < decades if low > 0 else False
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=7) if high / low > 1.5
                           else MaxNLocator(4))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda y, _: f"{y:g}" if 1e-4 <= y < 1e5 else significant(y, 1)))


def _dot(axes: Axes, found: Factor, style: Style, at: tuple[float, float], *, horizontal: bool) -> None:
    """A value with its interval, where there is one."""
    known = 0 < found.low <= found.value <= found.high < math.inf
    bar = [[found.value - found.low], [found.high - found.value]] if known else None
    axes.errorbar(*at, xerr=bar if horizontal else None, yerr=None if horizontal else bar, color=style.colour,
                  marker=style.marker, capsize=1.6, capthick=0.7, elinewidth=0.9, linestyle="none", zorder=4)


def _efficiencies(study: StudyResult) -> dict[str, Factor]:
    return {cost.estimator: Factor(1 / cost.ttuv.value, 1 / cost.ttuv.high, 1 / cost.ttuv.low if cost.ttuv.low else
                                   math.inf) for cost in costs_of(study).lines if cost.ttuv is not None}


def _look(item: StrategyResult) -> dict[str, Any]:
    """Dashed, with hollow markers, where a strategy does not suit; dotted where samples are spread evenly."""
    if not item.suits:
        return {"linestyle": (0, (3, 2)), "markerfacecolor": "white"}
    return {} if min(item.expected) >= EXPECTED_SLOPE else {"linestyle": (0, (1, 1.2))}


def _handle(item: StrategyResult, style: Style, label: str) -> Line2D:
    remark = "" if item.suits else " (not suited)"
    return Line2D([], [], color=style.colour, marker=style.marker, label=f"{label}{remark}", **_look(item))
