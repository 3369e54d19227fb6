"""The chapter on features: a crop of each side by side, from the studies' images. What is shown: features.toml."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from harness.report import formats
from harness.report.bars import signed_bar
from harness.report.blocks import Asset, Block, Chapter, Paragraph, Picture, PictureRow, Pictures
from harness.report.chapters.scenes import best_strategy
from harness.report.figures import pictures
from harness.report.inputs import Inputs
from harness.report.remembered import remembered_chapters
from harness.report.texts import read
from harness.results import FeatureImage, StrategyResult, StudyResult
from harness.samples.estimate import luminance
from harness.stats.findings import ROUNDING

PLACE = 18
TITLE, ANCHOR = "Feature by feature", "features"
# Maps of single pixels saturate at so many standard errors, which one pixel in 16,000 exceeds by chance.
_REACH = 4.0
# So many rows share a page.
_ROWS = 5


@dataclass(frozen=True)
class Crop:
    """A part of an image, in pixels."""

    left: int
    top: int
    right: int
    bottom: int

    @classmethod
    def of(cls, parts: list[float], shape: tuple[int, ...]) -> Crop:
        """From left, top, width and height as parts of an image; one pixel at the least, and inside."""
        height, width = shape[:2]
        left, top = min(int(parts[0] * width), width - 1), min(int(parts[1] * height), height - 1)
        return cls(left, top, min(left + max(round(parts[2] * width), 1), width),
                   min(top + max(round(parts[3] * height), 1), height))

    def cut(self, image: np.ndarray) -> np.ndarray:
        """The part of an image (H, W, …)."""
        return image[self.top:self.bottom, self.left:self.right]


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, with the features whose scenes were studied."""
    yield from remembered_chapters(partial(_chapters, inputs.results, inputs.features), __name__, inputs.results,
                                   inputs.features)


def _chapters(results: Sequence[StudyResult], images: Sequence[FeatureImage]) -> Iterator[Chapter]:
    studied = {result.scene: result for result in results}
    drawn = {(image.scene, image.side): image for image in images}
    rows = [_row(feature, studied[feature["scene"]], number, drawn) for number, feature in enumerate(_features())
            if feature["scene"] in studied and _shown(feature, studied[feature["scene"]])]
    if rows:
        parts = [tuple(rows[start:start + _ROWS]) for start in range(0, len(rows), _ROWS)]
        left_out = {feature["without"] for feature in _features() if "without" in feature}
        samples = sorted({image.samples for image in images if image.side in left_out})
        figures: list[Block] = [Pictures(_caption(samples, continued=index > 0), part, large=True)
                                for index, part in enumerate(parts)]
        yield Chapter(TITLE, ANCHOR, (Paragraph(_words()), *figures))


def sides_of(scene: str) -> tuple[str, ...]:
    """What is shown of a scene of this name besides its study, each once (see `results.FeatureImage.side`)."""
    return tuple(dict.fromkeys(side for feature in _features() if feature["scene"] == scene
                               for side in _sides(feature)))


def _features() -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = read("features.toml")["feature"]
    return found


def _sides(feature: dict[str, Any]) -> list[str]:
    return [feature["without"]] if "without" in feature else list(feature.get("strategies", ()))


def _words() -> str:
    return ("What the handout asks of a tracer, each where it shows: on the left the whole image with a frame, then "
            "what is in the frame, pixel by pixel: without the feature, with it, from the reference, and the "
            "difference of these two in standard errors of each pixel. Were a feature wrong, its outline would show "
            "there; noise has none. What is left out is left out of the scene as it was read, and nothing else is "
            "changed. Of what only saves samples two strategies are shown in place of that, with as many samples each.")


def _caption(samples: Sequence[int], *, continued: bool) -> str:
    if continued:
        return "Features, continued."
    without = f" Pictures without a feature are of {formats.words(list(map(formats.count, samples)))} samples."
    return (f"Features of the tracer. Images at the scene's exposure and sRGB-encoded.{without if samples else ''} "
            "Differences are of luminance, "
            f"{pictures.DARKER} where the tracer is darker, {pictures.BRIGHTER} where it is brighter, to "
            f"±{formats.count(_REACH)} standard errors, {pictures.NOTHING} where there is no noise. Beside a feature's "
            "name: the error of the mean in the frame, and the furthest deviate of the smaller tiles there; chance "
            "takes some tile of a scene beyond the bound in brackets as seldom as a verdict fails.")


def _shown(feature: dict[str, Any], result: StudyResult) -> bool:
    """Were the strategies studied that the feature is a matter of?"""
    return {strategy.strategy for strategy in result.strategies} >= set(feature.get("strategies", ()))


def _row(feature: dict[str, Any], result: StudyResult, number: int,
         drawn: Mapping[tuple[str, str], FeatureImage]) -> PictureRow:
    crop = Crop.of(feature["crop"], result.reference.mean.shape)
    whole = _framed(result.reference.mean, crop, result.exposure)
    first = _picture(f"feature-{number}-whole.png", whole, f"{result.scene}", f"{result.scene} with a frame")
    by_name = {strategy.strategy: strategy for strategy in result.strategies}
    names = feature.get("strategies", ())
    tests = [by_name[name] for name in names] or [best_strategy(result)]
    sides = {side: drawn[result.scene, side] for side in _sides(feature) if (result.scene, side) in drawn}
    seen = [(feature["title"], one.image) for side, one in sides.items() if side not in names]
    for test in tests:
        equal = sides.get(test.strategy)
        image, samples = (equal.image, equal.samples) if equal else (test.estimate.mean, test.estimate.samples)
        seen.append((f"{test.strategy}, {formats.count(samples)}{formats.NBSP}spp", image))
    shown = [_cropped(title, image, crop, result.exposure, f"feature-{number}-{index}.png")
             for index, (title, image) in enumerate(seen)]
    reference = pictures.display_png(crop.cut(result.reference.mean), result.exposure)
    shown.append(_picture(f"feature-{number}-reference.png", reference, "Reference", "Reference, cropped"))
    told = feature["words"]
    if not names:
        z = _deviates(tests[0], result, crop)
        file = f"feature-{number}-deviates.png"
        shown.append(Picture(Asset(file, pictures.difference_png(z, _REACH)), "Difference", "Deviates of the crop",
                             signed_bar(f"{formats.count(_REACH)}{formats.NBSP}σ")))
        told += f"; {_mean_words(tests[0], result, crop)}"
    return PictureRow((first, *shown), f"{feature['name']}: {told}")


def _cropped(title: str, image: np.ndarray, crop: Crop, exposure: float, file: str) -> Picture:
    return _picture(file, pictures.display_png(crop.cut(image), exposure), title, f"{title}, cropped")


def _picture(file: str, content: bytes, title: str, alt: str) -> Picture:
    return Picture(Asset(file, content), title, alt)


def _framed(image: np.ndarray, crop: Crop, exposure: float) -> bytes:
    """The whole image with a frame about the crop, white within black, which shows on any ground."""
    shown = image.copy()
    white, k = 2.0**-exposure, max(1, round(max(image.shape[:2]) / 160))
    for grow, level in ((2 * k, 0.0), (k, white)):
        top, left = max(crop.top - grow, 0), max(crop.left - grow, 0)
        bottom, right = crop.bottom + grow, crop.right + grow
        shown[top:top + k, left:right] = shown[bottom - k:bottom, left:right] = level
        shown[top:bottom, left:left + k] = shown[top:bottom, right - k:right] = level
    return pictures.display_png(shown, exposure)


def _deviates(strategy: StrategyResult, result: StudyResult, crop: Crop) -> np.ndarray:
    """Each pixel's difference in luminance over its standard error, zero where it is rounding; NaN without noise."""
    difference = luminance(crop.cut(strategy.estimate.mean) - crop.cut(result.reference.mean))
    variance = crop.cut(strategy.estimate.luminance_variance) + crop.cut(result.reference.luminance_variance)
    rounding = np.abs(difference) <= ROUNDING * luminance(crop.cut(result.reference.mean))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(variance > 0, np.where(rounding, 0.0, difference / np.sqrt(variance)), np.nan)


def _mean_words(strategy: StrategyResult, result: StudyResult, crop: Crop) -> str:
    """The error of the mean over the crop, and the furthest deviate of the smaller tiles that touch it.

    No standard error of the mean: where shapes move, the reference's pixels share their moments, and so their errors.
    """
    ours, theirs = (float(luminance(crop.cut(each.mean)).mean()) for each in (strategy.estimate, result.reference))
    tile, z = strategy.tiles.fine.tile, np.nan_to_num(strategy.tiles.fine.z)
    inside = z[crop.top // tile:-(-crop.bottom // tile), crop.left // tile:-(-crop.right // tile)]
    error = formats.percent(ours / theirs - 1, sign=True) if theirs else formats.MISSING
    return (f"mean {error}, tiles within {formats.number(float(np.abs(inside).max()), 1)}{formats.NBSP}σ "
            f"(chance: {formats.number(strategy.tiles.fine.critical, 1)})")
