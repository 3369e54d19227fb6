"""What an image may have been through after it was right: a factor, an exponent, a flip, a shift, exchanged channels.

Such slips of a contract look like physics to every test of a mean, and are none: they are fitted first.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from harness.diagnosis.causes.match import Fit, Seen, fit, loglik

# Factors that have a name, largest last; any other is told by its number.
FACTORS = {"1/2π": 0.5 / math.pi, "1/4": 0.25, "1/π": 1 / math.pi, "1/2": 0.5, "2": 2.0, "π": math.pi, "4": 4.0,
           "2π": 2 * math.pi}
CHANNELS = {(0, 2, 1): "green and blue exchanged", (1, 0, 2): "red and green exchanged",
            (2, 1, 0): "red and blue exchanged", (1, 2, 0): "the channels in the order green, blue, red",
            (2, 0, 1): "the channels in the order blue, red, green"}
LARGEST_SHIFT = 2  # pixels, either way
# What each parameter that is fitted, and each further transform, must gain in log-likelihood: Schwarz's criterion for
# a few thousand pixels.
PRICE = 4.0
TOLD = 5  # of the best


@dataclass(frozen=True, eq=False)
class Transformed:
    """The reference after a transform: `says` goes on after "right but for"; `picture` as it is compared;
    `price`: of its parameters, in log-likelihood; `shifted`: it was moved by pixels or halves of them."""

    says: str
    picture: Seen
    price: float
    shifted: bool = False


@dataclass(frozen=True)
class TransformFit:
    """A transform, and how well the reference after it, `picture`, fits; `fit.loglik` has its price taken off."""

    says: str
    fit: Fit
    picture: Seen


def fitted(found: Seen, reference: Seen, fine: Seen | None = None) -> list[TransformFit]:
    """The transforms of the reference that may explain an image, the likeliest first: single ones, and pairs of one
    that moves pixels and one that changes their values.

    `fine`: the reference at twice the width and height, without which nothing is shifted by half pixels. All are judged
    by the pixels that every one of them has.
    """
    inner = inner_pixels(reference.mean.shape[:2])
    reference = replace(reference, third=None)  # small, and not what it was after a transform
    scored: list[tuple[float, Transformed]] = []
    for moved in _moved(reference, fine):
        choices = _values(found, moved, inner) if not moved.shifted else _scalings(found, moved, inner)
        scored += [(loglik(found, choice.picture, inner) - choice.price, choice) for choice in choices if choice.says]
    best = sorted(scored, key=lambda item: -item[0])[:TOLD]
    return [TransformFit(choice.says, replace(fit(found, choice.picture, inner), loglik=score), choice.picture)
            for score, choice in best]


def inner_pixels(shape: tuple[int, ...]) -> np.ndarray:
    """(H, W): the pixels that no shift has lost."""
    inner = np.zeros(shape[:2], bool)
    edge = min(LARGEST_SHIFT, min(shape[:2]) // 4)
    inner[edge:shape[0] - edge, edge:shape[1] - edge] = True
    return inner


def _moved(reference: Seen, fine: Seen | None) -> Iterator[Transformed]:
    """The reference where it is, flipped, turned, and shifted."""
    height, width = reference.mean.shape[:2]
    yield Transformed("", reference, 0.0)
    flips: list[tuple[str, Callable[[np.ndarray], np.ndarray]]] = [
        ("left and right exchanged", lambda a: a[:, ::-1]), ("the image upside down", lambda a: a[::-1]),
        ("the image turned by half a turn", lambda a: a[::-1, ::-1])]
    if height == width:
        flips += [("rows and columns exchanged", lambda a: a.swapaxes(0, 1)),
                  ("the image turned by a quarter turn", lambda a: np.rot90(a)),
                  ("the image turned by three quarter turns", lambda a: np.rot90(a, 3))]
    for says, flip in flips:
        yield Transformed(says, _mapped(reference, flip), PRICE)
    steps = range(-LARGEST_SHIFT, LARGEST_SHIFT + 1)
    for down, right in itertools.product(steps, steps):
        if down or right:
            shifted = replace(reference, mean=np.roll(reference.mean, (down, right), (0, 1)),
                              variance=np.roll(reference.variance, (down, right), (0, 1)))
            yield Transformed(_shift(2 * down, 2 * right), shifted, 2 * PRICE, True)
    if fine is not None:
        halves = range(-2 * LARGEST_SHIFT + 1, 2 * LARGEST_SHIFT)
        for down, right in itertools.product(halves, halves):
            if down % 2 or right % 2:
                yield Transformed(_shift(down, right), _half_shifted(fine, down, right), 2 * PRICE, True)


def _half_shifted(fine: Seen, down: int, right: int) -> Seen:
    """What a box filter sees half pixels away: whole pixels of the image at twice the size, merged two by two."""
    height, width = fine.mean.shape[0] // 2, fine.mean.shape[1] // 2
    mean, variance = (np.roll(a, (down, right), axis=(0, 1)).reshape(height, 2, width, 2, 3)
                      for a in (fine.mean, fine.variance))
    return Seen(mean.mean((1, 3)), variance.sum((1, 3)) / 16, fine.inflation, fine.dof)


def _shift(down: int, right: int) -> str:
    """In words; both in half pixels."""
    parts = [f"{_halves(abs(value))} {words[value < 0]}" for value, words in (
        (right, ("to the right", "to the left")), (down, ("down", "up"))) if value]
    return f"a shift by {' and '.join(parts)}"


def _halves(count: int) -> str:
    if count == 1:
        return "half a pixel"
    return f"{count / 2:g} pixel{'s' if count != 2 else ''}"


def _values(found: Seen, moved: Transformed, inner: np.ndarray) -> Iterator[Transformed]:
    """The same with its values as they are, scaled, encoded, decoded, and in another order of channels."""
    yield from _scalings(found, moved, inner)
    for says, curve, slope in _curves():
        mean = curve(np.maximum(moved.picture.mean, 0.0))
        variance = moved.picture.variance * slope(np.maximum(moved.picture.mean, 1e-6)) ** 2
        encoded = replace(moved.picture, mean=mean, variance=variance)
        yield _then(moved, says, encoded, PRICE)
        if mean.max() > 1.0:
            clipped = replace(encoded, mean=np.minimum(mean, 1.0), variance=np.where(mean < 1.0, variance, 0.0))
            yield _then(moved, f"{says}, cut off at 1", clipped, PRICE)
    if moved.picture.mean.max() > 1.0:
        over = moved.picture.mean >= 1.0
        yield _then(moved, "values cut off at 1", replace(
            moved.picture, mean=np.minimum(moved.picture.mean, 1.0),
            variance=np.where(over, 0.0, moved.picture.variance)), PRICE)
    for order, says in CHANNELS.items():
        exchanged = replace(moved.picture, mean=moved.picture.mean[..., order],
                            variance=moved.picture.variance[..., order])
        yield _then(moved, says, exchanged, PRICE)


def _scalings(found: Seen, moved: Transformed, inner: np.ndarray) -> Iterator[Transformed]:
    """The same as it is, and scaled."""
    yield moved
    scaled = _scale(found, moved.picture, inner)
    if scaled is not None:
        named = [name for name, value in FACTORS.items() if abs(scaled / value - 1) < 0.05]
        for name in named:
            yield _then(moved, f"a factor of {name}", _multiplied(moved.picture, FACTORS[name]), PRICE)
        yield _then(moved, f"a factor of {scaled:.3g}", _multiplied(moved.picture, scaled), 2 * PRICE)


def _curves() -> list[tuple[str, Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], np.ndarray]]]:
    """Encodings: what they say, the curve, its slope."""
    def encode(x: np.ndarray) -> np.ndarray:
        return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)

    def encode_slope(x: np.ndarray) -> np.ndarray:
        return np.where(x <= 0.0031308, 12.92, 1.055 / 2.4 * np.maximum(x, 1e-6) ** (1 / 2.4 - 1))

    def decode(x: np.ndarray) -> np.ndarray:
        return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)

    def decode_slope(x: np.ndarray) -> np.ndarray:
        return np.where(x <= 0.04045, 1 / 12.92, 2.4 / 1.055 * ((x + 0.055) / 1.055) ** 1.4)

    return [("an exponent of 1/2.2 (encoded for a screen)", lambda x: x ** (1 / 2.2),
             lambda x: x ** (1 / 2.2 - 1) / 2.2),
            ("an exponent of 2.2 (decoded)", lambda x: x ** 2.2, lambda x: 2.2 * x ** 1.2),
            ("sRGB's curve (encoded for a screen)", encode, encode_slope),
            ("sRGB's curve backwards (decoded)", decode, decode_slope),
            ("an exponent of 1/2", lambda x: x ** 0.5, lambda x: 0.5 * x ** -0.5),
            ("a tone curve x/(1+x)", lambda x: x / (1 + x), lambda x: (1 + x) ** -2.0)]


def _scale(found: Seen, picture: Seen, inner: np.ndarray) -> float | None:
    """The factor by least squares, both pictures' noise weighed; None where there is no light, or it is 1."""
    factor = 1.0
    for _ in range(4):
        weight = np.where(inner[..., None], 1.0 / (found.variance + factor**2 * picture.variance + 1e-12), 0.0)
        # A reference's own noise would pull the factor towards zero.
        light = (weight * (picture.mean**2 - picture.variance)).sum()
        if light <= 0:
            return None
        factor = float((weight * picture.mean * found.mean).sum() / light)
        if factor <= 0:
            return None
    return factor if abs(factor - 1) > 1e-4 else None


def _multiplied(picture: Seen, factor: float) -> Seen:
    return replace(picture, mean=picture.mean * factor, variance=picture.variance * factor**2)


def _mapped(picture: Seen, change: Callable[[np.ndarray], np.ndarray]) -> Seen:
    return replace(picture, mean=change(picture.mean), variance=change(picture.variance))


def _then(moved: Transformed, says: str, picture: Seen, price: float) -> Transformed:
    both = f"{moved.says} and {says}" if moved.says else says
    return Transformed(both, picture, moved.price + price)
