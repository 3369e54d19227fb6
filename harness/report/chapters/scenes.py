"""A chapter a scene: description, images, curves and tables."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from harness.report import formats
from harness.report.bars import flip_bar, signed_bar
from harness.report.blocks import (
    Asset,
    Block,
    Chapter,
    Curves,
    Facts,
    Heading,
    Mark,
    Paragraph,
    Picture,
    PictureRow,
    Pictures,
    Remark,
    Remarks,
    Swatch,
)
from harness.report.figures import pictures
from harness.report.figures.style import strategy_style
from harness.report.inputs import Inputs, anchor_of
from harness.report.pixels import Pixels, Tested, plane
from harness.report.remembered import remembered_chapters
from harness.report.tables import EXPECTED_SLOPE, accuracy_table, cost_table, is_exact
from harness.report.tiles import deviates_row, deviates_words, failures, tiles_table
from harness.results import StrategyResult, StudyResult
from harness.stats.channels import Channel
from harness.stats.limit import limit_error
from harness.studies.equal_error import equal_error

PLACE = 20

# The finest colour scales worth drawing: below them a map shows rounding, not noise.
_FINEST_DIFFERENCE = 1e-4
_FINEST_FLIP = 1e-3
# A report on no more scenes than this holds the pixels of every strategy. Of 21 scenes they would make its page 23 MB
# larger, those of the least noisy strategy alone 7.
_FEW_SCENES = 3


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """One chapter a scene."""
    for result, stem in zip(inputs.results, inputs.stems, strict=True):
        yield from chapters_of(result, stem, len(inputs.results))


def chapters_of(result: StudyResult, stem: str, scenes: int) -> Sequence[Chapter]:
    """What a report on so many scenes says of one, as `scene_chapter`; read back where it was made before."""
    every = scenes <= _FEW_SCENES
    return remembered_chapters(partial(_chapters, result, stem, every), __name__, result, stem, every)


def _chapters(result: StudyResult, stem: str, every: bool) -> Iterator[Chapter]:
    yield scene_chapter(result, stem, anchor_of(stem), every=every)


def scene_chapter(result: StudyResult, stem: str, anchor: str, *, every: bool = True) -> Chapter:
    """The chapter on one scene; `stem` begins the names of its pictures. `every`: whether each strategy's pixels can be
    looked at, or those of the least noisy alone."""
    maps = {s.strategy: (pictures.difference_map(s.estimate.mean, result.reference.mean),
                         pictures.perceived_map(s.estimate.mean, result.reference.mean, result.exposure))
            for s in result.strategies}
    equal = equal_error(result)
    blocks: list[Block] = [
        *map(Paragraph, _paragraphs(result.description)), Facts(_facts(result)), Remarks(_remarks(result)),
        _images(result, best_strategy(result), maps, stem, every), _curves(result, stem), accuracy_table(result),
        Heading("The verdicts in words"), Remarks(_reasons(result), small=True), tiles_table(result)]
    if equal:
        blocks.append(cost_table(result, equal))
    if len(result.strategies) > 1:
        blocks.append(_differences(result, maps, stem))
    return Chapter(result.scene, anchor, tuple(blocks))


def best_strategy(result: StudyResult) -> StrategyResult:
    """The suitable strategy with the least RMSE at the end of its run; any strategy where none suits."""
    candidates = [strategy for strategy in result.strategies if strategy.suits] or list(result.strategies)
    return min(candidates, key=lambda strategy: float(np.nan_to_num(strategy.score("rmse"), nan=np.inf)))


def _paragraphs(text: str) -> tuple[str, ...]:
    """A comment's paragraphs (between blank lines), each on one line."""
    return tuple(" ".join(part.split()) for part in re.split(r"\n\s*\n", text) if part.strip())


def _facts(result: StudyResult) -> tuple[str, ...]:
    height, width = result.reference.mean.shape[:2]
    reference = result.reference
    spp = f", {formats.count(reference.samples)} samples per pixel" if reference.samples else ""
    replicas = [strategy.curves["rmse"].shape[0] for strategy in result.strategies]
    lengths = [int(strategy.spp[-1]) for strategy in result.strategies]
    return (f"{width} × {height} pixels", f"reference: {result.reference_kind}{spp}",
            f"each strategy: {formats.span(replicas, 'replica')} of {formats.span(lengths, 'sample')} per pixel",
            f"exposure {formats.number(result.exposure, 1, sign=True)} stops")


def _remarks(result: StudyResult) -> tuple[Remark, ...]:
    """Notes of the loader, strategies that do not suit and why, and those that are exact."""
    remarks = [Remark(formats.sentence(note)) for note in result.notes]
    for strategy in result.strategies:
        if not strategy.suits or strategy.warning:
            head = "" if strategy.suits else f"{strategy.strategy} does not suit this scene. "
            told = f"{strategy.strategy}: {strategy.warning}" if strategy.suits else strategy.warning
            remarks.append(Remark((head + (formats.sentence(told) if told else "")).strip(), "warning"))
        if is_exact(strategy):
            remarks.append(Remark(f"{strategy.strategy} is exact here: every sample gives the same answer, so there "
                                  "is no noise to fit a slope to.", "exact"))
    return tuple(remarks)


def _reasons(result: StudyResult) -> tuple[Remark, ...]:
    """Each verdict in words; a strategy that does not suit carries the warning's mark, not a verdict's."""
    remarks = []
    for strategy in result.strategies:
        mark: Mark = strategy.verdict.outcome if strategy.suits else "warning"
        dof = float(strategy.verdict.dof[Channel.LUMINANCE])
        known = f" ({formats.count(dof)} degrees of freedom in luminance)" if np.isfinite(dof) else ""
        remarks.append(Remark(f"{strategy.strategy}: {formats.typographic(strategy.verdict.reason)}{known}."
                              f"{_limit_words(strategy, result)}", mark))
        remarks += failures(strategy)
    return tuple(remarks)


def _limit_words(strategy: StrategyResult, result: StudyResult) -> str:
    """What would be left of a strategy's RMSE with endless samples; nothing where that is unknown."""
    estimate, reference = strategy.estimate, result.reference
    limit = limit_error(estimate.mean, estimate.variance, reference.mean, reference.variance,
                        strategy.verdict.confidence)
    if not np.isfinite(limit.high):
        return ""
    return (f" With endless samples {formats.percent(limit.value)} of its RMSE would be left, relative to the "
            f"reference ({formats.percent(limit.low)} to {formats.percent(limit.high)}).")


Maps = dict[str, tuple[np.ndarray, np.ndarray]]


def _images(result: StudyResult, best: StrategyResult, maps: Maps, stem: str, every: bool) -> Pictures:
    """GLSL, reference, signed difference and FLIP of the least noisy strategy; of the only one also its tiles."""
    reference = result.reference.mean
    difference, perceived = maps[best.strategy]
    limit = pictures.robust_limit([difference], _FINEST_DIFFERENCE)
    flip_limit = min(pictures.robust_limit([perceived], _FINEST_FLIP), 1.0)
    files = {name: Asset(f"{stem}-{name}.png", content) for name, content in (
        ("glsl", pictures.display_png(best.estimate.mean, result.exposure)),
        ("reference", pictures.display_png(reference, result.exposure)),
        ("difference", pictures.difference_png(difference, limit)),
        ("flip", pictures.perceived_png(perceived, flip_limit)))}
    caption = (f"{result.scene}: the GLSL estimate ({best.strategy}, {formats.count(best.estimate.samples)} samples "
               f"per pixel) and the reference ({result.reference_kind}), both at the scene's fixed exposure and "
               f"sRGB-encoded; their signed relative difference in luminance, {pictures.DARKER} where GLSL is darker, "
               f"{pictures.BRIGHTER} where it is brighter; and the FLIP map, mean "
               f"{formats.number(best.score('flip'), 4)}. {_scale_words(reference)}")
    tiles: tuple[Picture, ...] = ()
    if len(result.strategies) == 1:
        row = deviates_row(result, stem)
        tiles = (replace(row.pictures[0], title="Smaller tiles", bar=row.bar),)
        caption += f" {deviates_words(result)}"
    return Pictures(caption, (PictureRow((
        Picture(files["glsl"], f"GLSL, {best.strategy}", f"GLSL render of {result.scene}"),
        Picture(files["reference"], _reference_title(result), f"Reference render of {result.scene}"),
        Picture(files["difference"], "Relative difference", f"Signed relative difference, within ±{limit:g}",
                signed_bar(formats.share(limit))),
        Picture(files["flip"], "FLIP", f"FLIP map up to {flip_limit:g}", flip_bar(flip_limit)),
        *tiles)),), _pixels(result, best, maps, limit, flip_limit, every))


def _pixels(result: StudyResult, best: StrategyResult, maps: Maps, difference_limit: float, flip_limit: float,
            every: bool) -> Pixels:
    """The numbers of the images, the least noisy strategy first, as small as the pictures are shown."""
    k = pictures.shrink_factor(result.reference.mean)
    others = [each for each in result.strategies if every and each is not best]
    tested = []
    for strategy in (best, *others):
        difference, perceived = maps[strategy.strategy]
        fine = strategy.tiles.fine
        tested.append(Tested(strategy.strategy, plane(pictures.shrink(strategy.estimate.mean)), plane(difference),
                             plane(perceived), plane(fine.z), fine.tile / k))
    return Pixels(_reference_title(result), plane(pictures.shrink(result.reference.mean)), tuple(tested),
                  result.exposure, difference_limit, flip_limit, best.tiles.fine.critical)


def _differences(result: StudyResult, maps: Maps, stem: str) -> Pictures:
    """Signed difference, FLIP and deviates of tiles of every strategy, on scales that they share."""
    suited = [maps[s.strategy] for s in result.strategies if s.suits] or list(maps.values())
    limit = pictures.robust_limit([difference for difference, _ in suited], _FINEST_DIFFERENCE)
    flip_limit = min(pictures.robust_limit([perceived for _, perceived in suited], _FINEST_FLIP), 1.0)
    signed, noticed = [], []
    for strategy in result.strategies:
        name, style = strategy.strategy, strategy_style(strategy.strategy)
        difference, perceived = maps[name]
        files = (Asset(f"{stem}-difference-{name}.png", pictures.difference_png(difference, limit)),
                 Asset(f"{stem}-flip-{name}.png", pictures.perceived_png(perceived, flip_limit)))
        title = name if strategy.suits else f"{name} (not suited)"
        swatch = Swatch(style.glyph, style.colour)
        signed.append(Picture(files[0], title, f"Signed relative difference of {name}", swatch=swatch))
        noticed.append(Picture(files[1], "", f"FLIP map of {name}"))
    caption = (f"{result.scene}: all strategies at the end of their runs, replicas merged, on common scales. An "
               "unbiased strategy leaves noise that averages out; an even patch of one colour would be bias. "
               f"Faint blue with scattered {pictures.BRIGHTER} is a heavy tail: rare bright samples carry the light. "
               f"{_scale_words(result.reference.mean)} {deviates_words(result)}")
    return Pictures(caption, (
        PictureRow(tuple(signed), "Signed relative difference", signed_bar(formats.share(limit))),
        PictureRow(tuple(noticed), "FLIP", flip_bar(flip_limit)),
        deviates_row(result, stem)))


def _scale_words(image: np.ndarray) -> str:
    """How the colour scales were chosen, and that large images are shown smaller."""
    k = pictures.shrink_factor(image)
    reduced = f" Shown averaged over {k} × {k} pixels." if k > 1 else ""
    return f"Colour scales reach to {pictures.ROBUST_WORDS}, rounded up; what lies beyond saturates.{reduced}"


def _reference_title(result: StudyResult) -> str:
    return result.reference_kind[:1].upper() + result.reference_kind[1:]


def _curves(result: StudyResult, stem: str) -> Curves:
    from harness.report.figures.convergence import curves_svg

    file = Asset(f"{stem}-curves.svg", curves_svg(result))
    level = formats.levels(strategy.verdict.confidence for strategy in result.strategies)
    caption = (f"{result.scene}: convergence of each strategy. Lines are means over the replicas (geometric for RMSE "
               f"and 1 − SSIM), bands their {level} confidence intervals. Left: RMSE; grey diagonals fall with slope "
               f"{formats.fraction(EXPECTED_SLOPE)}. Middle: mean error; the shaded strip is the tolerance, inside "
               "which the axis is linear, outside logarithmic; the points at the right are the verdicts, all replicas "
               f"merged, with their intervals. Right: SSIM.{_fit_words(result)}")
    names = formats.words([strategy.strategy for strategy in result.strategies])
    return Curves(caption, file, f"RMSE, mean error and SSIM of {names} against samples per pixel")


def _fit_words(result: StudyResult) -> str:
    """What the slopes in the legend were fitted to."""
    slopes = [strategy.slope for strategy in result.strategies if strategy.slope]
    if not slopes:
        return ""
    points = formats.span([slope.points for slope in slopes], "point")
    replicas = formats.span([slope.replicas for slope in slopes], "replica")
    levels = formats.levels(slope.confidence for slope in slopes)
    return f" Slopes, with {levels} intervals, are fitted to {points} of {replicas}."
