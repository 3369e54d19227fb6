"""Histograms of pixels' deviates against the normal density, a small panel a scene, as one vector figure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from harness.report.figures.svg import blank, svg
from harness.report.formats import number
from harness.results import StrategyResult, StudyResult
from harness.samples.estimate import luminance
from harness.stats.deviates import satterthwaite, skew_deviate

WIDTH_CM, ROW_CM = 17.0, 3.3
COLUMNS = 4
# Bins reach this far on either side of zero; what lies beyond is in the last ones.
REACH, BINS = 5.0, 50
# What is less than this part of a pixel's radiance is rounding to float32, and no noise.
_ROUNDING = 1e-6
_FILL, _EDGE = "#b9c6d3", "#5b6b7a"


@dataclass(frozen=True)
class Deviates:
    """The deviates of a scene's pixels: `z`, (N,), of those that have noise; which strategy's they are."""

    scene: str
    strategy: str
    z: np.ndarray

    @property
    def spread(self) -> float:
        """Their root mean square, 1 of normal deviates."""
        return float(np.sqrt(np.mean(self.z**2)))

    def beyond(self, bound: float) -> float:
        """The share that lies further from zero than `bound`."""
        return float(np.mean(np.abs(self.z) > bound))


def pixel_deviates(result: StudyResult, strategy: StrategyResult) -> Deviates:
    """Each pixel's difference in luminance over its standard error, by Welch's statistic, as a normal deviate.

    Pixels without noise on either side have none: a sky that is seen directly, a closed form that is exact.
    """
    test, reference = strategy.estimate, result.reference
    difference = luminance(test.mean - reference.mean)
    squares, total = np.zeros_like(difference), np.zeros_like(difference)
    for each in (test, reference):
        variance = each.luminance_variance
        total += variance
        squares += variance**2 / max(each.batches - 1, 1)
    noisy = np.isfinite(total) & (np.sqrt(total) > _ROUNDING * np.abs(luminance(reference.mean)))
    difference, total, squares = difference[noisy], total[noisy], squares[noisy]
    z = skew_deviate(difference, total, np.zeros_like(total), satterthwaite(total, squares))
    return Deviates(result.scene, strategy.strategy, z)


def deviates_svg(shown: Sequence[Deviates]) -> bytes:
    """The figure as SVG, of one scene or more."""
    return svg(lambda: _panels(shown), "deviates", of=list(shown))


def _panels(shown: Sequence[Deviates]) -> Figure:
    rows = math.ceil(len(shown) / COLUMNS)
    height = rows * ROW_CM + 0.5
    figure = blank(WIDTH_CM, height)
    panels = figure.subplots(rows, COLUMNS, squeeze=False, sharex=True, sharey=True).ravel()
    figure.subplots_adjust(left=0.045, right=0.99, bottom=0.9 / height, top=1 - 0.65 / height, wspace=0.08,
                           hspace=0.42)
    for axes, deviates in zip(panels, shown, strict=False):
        _panel(axes, deviates)
    for axes in panels[len(shown):]:
        axes.set_axis_off()
    for axes in panels[max(len(shown) - COLUMNS, 0):len(shown)]:
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("z", labelpad=1)
    return figure


def _panel(axes: Axes, deviates: Deviates) -> None:
    edges = np.linspace(-REACH, REACH, BINS + 1)
    counts, _ = np.histogram(np.clip(deviates.z, -REACH, REACH), edges)
    density = counts / max(counts.sum(), 1) / (edges[1] - edges[0])
    axes.stairs(density, edges, fill=True, color=_FILL, zorder=1)
    axes.stairs(density, edges, color=_EDGE, linewidth=0.6, zorder=2)
    x = np.linspace(-REACH, REACH, 161)
    axes.plot(x, np.exp(-x**2 / 2) / np.sqrt(2 * np.pi), color="black", linewidth=1.0, linestyle=(0, (3, 1.5)),
              zorder=3)
    axes.set_xlim(-REACH, REACH)
    axes.set_ylim(0, 0.52)
    axes.xaxis.set_major_locator(FixedLocator([-4, -2, 0, 2, 4]))
    axes.yaxis.set_major_locator(FixedLocator([0, 0.2, 0.4]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_title(f"{deviates.scene}, {deviates.strategy}", loc="left", fontsize=7.2)
    axes.text(0.985, 0.95, f"spread {number(deviates.spread, 2)}", ha="right", va="top", transform=axes.transAxes,
              fontsize=6.8)
