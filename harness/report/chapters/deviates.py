"""The chapter on noise: are the differences that are left what chance makes of two right images?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from harness.report import formats
from harness.report.blocks import Asset, Chapter, Curves, Paragraph, Remark, Remarks
from harness.report.inputs import Inputs
from harness.report.remembered import remembered_chapters
from harness.report.texts import paragraph
from harness.results import StudyResult
from harness.stats.deviates import one_sided

if TYPE_CHECKING:
    from harness.report.figures.deviates import Deviates

PLACE = 25
TITLE, ANCHOR = "Is what is left noise?", "deviates"
# A deviate that chance exceeds seldom; how often, the text computes.
_FAR = 3.0
# Scenes whose pixels' deviates spread by so much more or less than 1 are named.
_OFF = 0.05


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, where any pixel has noise."""
    yield from remembered_chapters(partial(_chapters, inputs.results), __name__, inputs.results)


def _chapters(results: Sequence[StudyResult]) -> Iterator[Chapter]:
    shown = [found for result in results if (found := _least_noisy(result))]
    if shown:
        yield Chapter(TITLE, ANCHOR, (_words(), Remarks(_remarks(shown)), _figure(shown)))


def _least_noisy(result: StudyResult) -> Deviates | None:
    """Those of the suitable strategy with the least RMSE that has noise at all; None where none has."""
    from harness.report.figures.deviates import pixel_deviates

    suited = sorted((strategy for strategy in result.strategies if strategy.suits),
                    key=lambda strategy: float(np.nan_to_num(strategy.score("rmse"), nan=np.inf)))
    found = (pixel_deviates(result, strategy) for strategy in suited)
    return next((deviates for deviates in found if deviates.z.size), None)


def _words() -> Paragraph:
    return paragraph(
        "Were both images right and their noise normal, then each pixel's difference, over its own standard error, "
        "would be a draw from the normal distribution N(0, 1): a bias shifts the histogram, an error in some places "
        "widens it or lifts its tails [jung2020]. Variances are measured from the batches of both sides, pixel by "
        "pixel. Where few paths of a pixel carry most of its light, single pixels are not normal, and the histogram "
        "leans or narrows though nothing is wrong; therefore verdicts are made of means over many pixels and correct "
        "for skewness, and none is made of these.")


def _remarks(shown: Sequence[Deviates]) -> tuple[Remark, ...]:
    pixels = sum(deviates.z.size for deviates in shown)
    spreads = sorted((deviates.spread, deviates.scene) for deviates in shown)
    beyond = sum(deviates.beyond(_FAR) * deviates.z.size for deviates in shown) / pixels
    off = [scene for spread, scene in spreads if abs(spread - 1) > _OFF]
    return (Remark(
        f"Of {formats.count(pixels)} pixels with noise {formats.percent(beyond, decimals=2)} lie beyond "
        f"±{formats.count(_FAR)} standard errors; normal noise would put "
        f"{formats.percent(2 * one_sided(_FAR), decimals=2)} there. The root mean square of a scene's deviates is "
        f"{formats.number(spreads[0][0], 2)} ({spreads[0][1]}) to {formats.number(spreads[-1][0], 2)} "
        f"({spreads[-1][1]})"
        + (f"; off by more than {formats.number(_OFF, 2)}: {formats.words(off)}." if off else ".")),)


def _figure(shown: Sequence[Deviates]) -> Curves:
    from harness.report.figures.deviates import deviates_svg

    caption = (
        "Deviates of pixels in luminance, of each scene's least noisy strategy, all replicas merged, against the "
        "reference (grey), and the density of N(0, 1) (dashed). What lies beyond the axis is in the outermost bins. "
        "Spread: root mean square.")
    names = formats.words([deviates.scene for deviates in shown])
    return Curves(caption, Asset("deviates.svg", deviates_svg(shown)), f"Histograms of pixels' deviates of {names}")
