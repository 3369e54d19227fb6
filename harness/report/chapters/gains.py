"""The chapter on convergence over all scenes: what each strategy and sampler saves until the same error."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from harness.report import formats
from harness.report.blocks import Asset, Cell, Chapter, Column, Curves, Paragraph, Table
from harness.report.inputs import Inputs
from harness.report.remembered import remembered_chapters
from harness.report.tables import strategy_cell
from harness.results import StudyResult
from harness.studies.equal_error import BASELINE, Cost, equal_error

if TYPE_CHECKING:  # figures import matplotlib, half a second that pages which are read back need not wait for
    from harness.report.figures.gains import Row

PLACE = 17
TITLE, ANCHOR = "What strategies and samplers buy", "gains"


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, where on any scene two strategies have a slope."""
    yield from remembered_chapters(partial(_chapters, inputs.results), __name__, inputs.results)


def _chapters(results: Sequence[StudyResult]) -> Iterator[Chapter]:
    from harness.report.figures.gains import gains_svg

    rows = [(result.scene, equal) for result in results if (equal := equal_error(result))]
    if rows:
        caption = (
            f"How many times sooner than the baseline ({BASELINE}, or else the scene's first strategy) each strategy "
            "reaches the same error, by the clock of the device that drew both; lines are intervals over replicas. "
            "Right of the upright line a strategy pays. Hollow marks: numbers that are spread evenly.")
        figure = Curves(caption, Asset("gains.svg", gains_svg(rows)), "Gains in time at equal error, a row a scene")
        yield Chapter(TITLE, ANCHOR, (Paragraph(_words()), figure, _table(rows)))


def _words() -> str:
    return ("An image is right with any strategy; what differs is how long it is noisy. On each scene all strategies "
            "are brought to the same RMSE, the largest that a suitable one still has at the end of its run, by the "
            "power laws that were fitted to their curves, which the scene's own pages show. A better strategy costs "
            "more a sample, which is counted here, and may gain nothing where light comes from everywhere.")


def _table(rows: Sequence[Row]) -> Table:
    """Over the scenes, what each strategy and sampler gains in the middle, at the least and at the most."""
    found: dict[str, list[tuple[float, str, Cost]]] = {}
    slopes: dict[str, list[float]] = {}
    for scene, equal in rows:
        for cost in equal.costs:
            name = cost.strategy.strategy
            if cost.strategy.slope is not None:
                slopes.setdefault(name, []).append(cost.strategy.slope.slope)
            if cost.time_gain and np.isfinite(cost.time_gain.value):
                found.setdefault(name, []).append((cost.time_gain.value, scene, cost))
    body = []
    for name, each in found.items():
        ordered = sorted(each, key=lambda one: one[0])
        body.append((
            strategy_cell(ordered[0][2].strategy), Cell(formats.count(len(each))),
            Cell(_times(float(np.median([value for value, *_ in each])))),
            *(Cell(f"{_times(value)} ({scene})") for value, scene, _ in (ordered[0], ordered[-1])),
            Cell(f"{formats.number(min(slopes[name]), 2)} … {formats.number(max(slopes[name]), 2)}")))
    caption = ("Gains in time over the scene's baseline, in the middle of the scenes and at the extremes, and the "
               "slopes of RMSE that were fitted. Strategies are shown on different scenes, so rows compare only "
               "roughly.")
    columns = (Column("Strategy", share=1), Column("Scenes", "right"), Column("Middle", "right"),
               Column("Least", "right"),
               Column("Most", "right"), Column("Slopes", "right"))
    return Table(caption, columns, tuple(body))


def _times(value: float) -> str:
    return f"{formats.significant(value, 2)}{formats.TIMES}"
