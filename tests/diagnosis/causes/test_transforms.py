"""Transforms of an image: each is found by its name, and a right image has none."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from harness.diagnosis.causes.match import Seen, fit
from harness.diagnosis.causes.transforms import fitted
from harness.samples.estimate import Batch, Estimate, merge
from harness.samples.tone import encode_srgb

SIZE = (24, 32)


def picture(scale: int = 1) -> np.ndarray:
    """A scene of blobs and edges, as a box filter sees it at `scale` times the size."""
    fine = 8
    y, x = np.mgrid[0:SIZE[0] * fine, 0:SIZE[1] * fine] / fine
    image = 0.1 + 0.03 * x + 0.8 * ((x - 9) ** 2 + (y - 8) ** 2 < 30) + 0.5 * (np.abs(x - 22) + np.abs(y - 15) < 6)
    side = fine // scale
    merged = image.reshape(SIZE[0] * scale, side, SIZE[1] * scale, side).mean((1, 3))
    return merged[..., None] * np.array([1.0, 0.7, 0.4])


LIGHT, FINE = picture(), picture(2)


def noisy(image: np.ndarray, seed: int = 1, noise: float = 0.03) -> Seen:
    rng = np.random.default_rng(seed)
    return Seen.of(merge(Batch(image * (1 + noise * math.sqrt(8) * rng.normal(size=(*image.shape[:2], 1))), 16)
                         for _ in range(8)))


def shifted(down: int, right: int) -> np.ndarray:
    """By half pixels."""
    return np.roll(FINE, (down, right), (0, 1)).reshape(SIZE[0], 2, SIZE[1], 2, 3).mean((1, 3))


@pytest.mark.parametrize(("change", "says"), [
    (lambda a: a / math.pi, "a factor of 1/π"),
    (lambda a: 2 * a, "a factor of 2"),
    (lambda a: 1.37 * a, "a factor of 1.37"),
    (lambda a: a ** (1 / 2.2), "an exponent of 1/2.2 (encoded for a screen)"),
    (lambda a: a ** 2.2, "an exponent of 2.2 (decoded)"),
    (lambda a: encode_srgb(a), "sRGB's curve (encoded for a screen), cut off at 1"),
    (lambda a: np.minimum(a, 1.0), "values cut off at 1"),
    (lambda a: a[::-1], "the image upside down"),
    (lambda a: a[:, ::-1], "left and right exchanged"),
    (lambda a: a[..., ::-1], "red and blue exchanged"),
    (lambda a: np.roll(a, 1, 1), "a shift by 1 pixel to the right"),
    (lambda a: shifted(-1, 1), "a shift by half a pixel to the right and half a pixel up"),
    (lambda a: a[::-1] ** (1 / 2.2), "the image upside down and an exponent of 1/2.2 (encoded for a screen)"),
])
def test_finds_it_by_its_name(change: Callable[[np.ndarray], np.ndarray], says: str) -> None:
    reference = Estimate.exact(LIGHT)
    found = noisy(change(LIGHT))
    best = fitted(found, Seen.of(reference), Seen.of(Estimate.exact(FINE)))[0]
    assert best.says == says
    assert best.fit.same


def test_none_explains_another_picture() -> None:
    other = LIGHT * np.where(np.arange(SIZE[1]) < 16, 2.0, 0.5)[None, :, None]
    assert not any(item.fit.same for item in fitted(noisy(other), Seen.of(Estimate.exact(LIGHT))))


def test_noise_of_the_reference_does_not_pull_the_factor_down() -> None:
    """With as much noise on both sides, least squares would find 2.4 for 3."""
    best = fitted(noisy(3 * LIGHT, 1, 0.5), noisy(LIGHT, 2, 0.5))
    factor = next(float(item.says.removeprefix("a factor of ")) for item in best if "factor of 2." in item.says
                  or "factor of 3." in item.says or item.says == "a factor of 3")
    assert factor == pytest.approx(3.0, rel=0.05)


def test_a_right_image_is_no_worse_than_any_transform_of_it() -> None:
    found, right = noisy(LIGHT, 1), noisy(LIGHT, 2)
    assert fit(found, right).same
