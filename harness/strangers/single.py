"""Single frames of a shader whose law is known: each drawn on an empty past, and undone into a sample of radiance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from harness.gpu.frames import Moment
from harness.shader.contract import Contract, Law

Encoding = Literal["", "gamma", "sqrt", "srgb"]
# The exponent of the encodings that are a power.
EXPONENTS = {"gamma": 2.2, "sqrt": 2.0}


class FrameSource(Protocol):
    """What draws frames: `harness.gpu.frames.Frames` itself, or the same in a child process."""

    @property
    def contract(self) -> Contract: ...
    @property
    def size(self) -> tuple[int, int]: ...
    def frame(self, moment: Moment) -> None: ...
    def read(self, name: str) -> np.ndarray: ...
    def write(self, name: str, pixels: np.ndarray) -> None: ...
    def clear(self, value: float = 0.0) -> None: ...


@dataclass(frozen=True, eq=False)
class Singles:
    """Samples of single frames: their `sum`, (H, W, 3) float64, of those that were finite, of which each pixel
    `counted` so many, (H, W); and, where asked for, all of them, (F, H, W, 3) float32. Rows as GL's."""

    sum: np.ndarray
    counted: np.ndarray
    frames: int
    stack: np.ndarray | None = None

    @property
    def rejected(self) -> int:
        """Samples over the whole image that were not finite."""
        return self.frames * self.counted.size - int(self.counted.sum())

    @property
    def mean(self) -> np.ndarray:
        """Of those that were finite, (H, W, 3); 0 where none was."""
        counted = self.counted[..., None]
        return np.divide(self.sum, counted, out=np.zeros_like(self.sum), where=counted > 0)


def decoded(pixels: np.ndarray, encoding: Encoding) -> np.ndarray:
    """Values that are kept encoded, as radiance; below zero they stay what they are."""
    if not encoding:
        return pixels
    positive = np.maximum(pixels, 0.0)
    if encoding == "srgb":
        return np.where(pixels <= 0.04045, pixels / 12.92, ((positive + 0.055) / 1.055)**2.4)
    return np.where(pixels < 0, pixels, positive**EXPONENTS[encoding])


def encoded(radiance: np.ndarray, encoding: Encoding) -> np.ndarray:
    """The inverse of `decoded`."""
    if not encoding:
        return radiance
    positive = np.maximum(radiance, 0.0)
    if encoding == "srgb":
        return np.where(radiance <= 0.0031308, 12.92 * radiance, 1.055 * positive**(1 / 2.4) - 0.055)
    return np.where(radiance < 0, radiance, positive**(1 / EXPONENTS[encoding]))


def past_weight(law: Law, n: int) -> float:
    """a(n): what a law gives the past of n frames; of a mean that counts in alpha the past is empty, so it is 0."""
    match law.kind:
        case "sum":
            return 1.0
        case "mean":
            counted = n + law.offset
            return 0.0 if law.count in ("alpha", "inverse_alpha") or counted <= 0 else counted / (counted + 1)
        case "blend":
            return law.weight
        case _:
            return 0.0


def sample(pixels: np.ndarray, law: Law, n: int) -> np.ndarray:
    """What a frame, (H, W, 4), drawn on an empty past when n frames were counted, adds: radiance, (H, W, 3) float64.

    A sum that counts in alpha is divided by what it counted; what else has a weight b(n) = 1 - a(n) by that.
    """
    pixels = np.asarray(pixels, dtype=np.float64)
    colour = decoded(pixels[..., :3], law.encoding)
    if law.kind == "sum":
        if law.count != "alpha":
            return colour
        counted = pixels[..., 3:]
        return np.divide(colour, counted, out=np.zeros_like(colour), where=counted > 0)
    weight = 1.0 - past_weight(law, n)
    return colour / weight if weight > 0 else colour


def draw_singles(source: FrameSource, law: Law, numbers: Sequence[int], *, encoding: Encoding = "", keep: bool = False,
                 seconds: float | None = None, count: int | None = None,
                 tell: Callable[[int], None] | None = None) -> Singles:
    """The samples of the frames with these numbers, each on an empty past.

    `encoding`: what each frame was put through before it was averaged, to be undone. `seconds`: the clock stands there
    instead of running. `count`: how many frames the host says are in the past, if not as many as the number says.
    """
    name, first = source.contract.radiance, source.contract.first_frame
    width, height = source.size
    total = np.zeros((height, width, 3))
    counted = np.zeros((height, width))
    stack = []
    for number in numbers:
        n = max(number - first, 0) if count is None else count
        moment = Moment.of(number, n)
        source.clear()
        source.frame(moment if seconds is None else Moment(number, n, seconds, number))
        with np.errstate(invalid="ignore", over="ignore"):
            found = decoded(sample(source.read(name), law, n), encoding)
        finite = np.isfinite(found).all(axis=-1)
        counted += finite
        if keep:
            stack.append(found.astype(np.float32))
        total += np.where(finite[..., None], found, 0.0)
        if tell:
            tell(1)
    return Singles(total, counted, len(numbers), np.stack(stack) if stack else None)


def loop(source: FrameSource, frames: int, *, first: int | None = None) -> np.ndarray:
    """What the author's own loop leaves after so many frames, (H, W, 4), from nothing."""
    start = source.contract.first_frame if first is None else first
    source.clear()
    for n in range(frames):
        source.frame(Moment.of(start + n, n))
    return source.read(source.contract.radiance)
