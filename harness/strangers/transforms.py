"""What may be done to a right picture before it is handed in, and is no fault of a path tracer's physics.

A factor (of π, of two), a mirrored axis, channels in another order, a shift by half a pixel. Such a transform explains a
picture where, once it is undone, no verdict fails any more. Arrays only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from harness.samples.estimate import with_luminance
from harness.stats.tiles import TileAccumulator, TileSamples, tile_means, tile_size

# Factors with a name, and how near a fitted one must be to have it.
FACTORS = {"π": np.pi, "1/π": 1 / np.pi, "2": 2.0, "1/2": 0.5, "4": 4.0, "1/4": 0.25, "2π": 2 * np.pi,
           "1/2π": 0.5 / np.pi, "4π": 4 * np.pi, "1/4π": 0.25 / np.pi}
NAMED = 0.01
# Half pixels by which a picture may be shifted: (right, down).
SHIFTS = tuple((x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y)
# Candidates whose verdict is asked for, the likeliest first.
TRIED = 4
# A tile darker than this part of the mean says nothing of factors.
DARK = 0.01


@dataclass(frozen=True)
class Transform:
    """What was done to the picture. `told`: as a message has it; `undo`: makes images (B, H, W, 3) right again;
    `factor`: 1 where it is none."""

    name: str
    told: str
    undo: Callable[[np.ndarray], np.ndarray]
    factor: float = 1.0


def samples_of(images: np.ndarray, frames: int) -> TileSamples:
    """Batches of `frames` samples, (B, H, W, 3), as tiles."""
    tiles = TileAccumulator(tile_size(*images.shape[1:3]))
    for image in images:
        tiles.add(with_luminance(image), frames)
    return tiles.samples()


def candidates(images: np.ndarray, reference: np.ndarray) -> list[Transform]:
    """The transforms that may explain batches (B, H, W, 3), the likeliest first; `reference`: (H, W, 3)."""
    tile = tile_size(*reference.shape[:2])
    truth = tile_means(reference, tile)
    noise = tile_means(images.reshape(-1, *images.shape[2:]).reshape(images.shape).var(axis=0, ddof=1), tile)
    scale = float(np.abs(truth).mean()) or 1.0
    weight = 1 / (noise / len(images) + (DARK * scale)**2)
    ranked: list[tuple[float, int, Transform]] = []
    for flip in _rearranged(images.shape[1:3]):
        found = tile_means(flip.undo(images).mean(axis=0), tile)
        factor = float((weight * found * truth).sum() / (weight * truth**2).sum()) if truth.any() else 1.0
        for one in (flip, *_scaled(flip, factor)):
            away = float((weight * (found / one.factor - truth)**2).sum())
            ranked.append((away, len(ranked), one))
    return [one for _, _, one in sorted(ranked, key=lambda entry: entry[:2]) if one.name][:TRIED]


def _rearranged(size: tuple[int, int]) -> Iterator[Transform]:
    """Pixels and channels in another order; the first is none."""
    yield Transform("", "", lambda images: images)
    yield Transform("flip x", "mirrored, left to right", lambda images: images[:, :, ::-1])
    yield Transform("flip y", "upside down", lambda images: images[:, ::-1])
    yield Transform("flip xy", "turned by 180°", lambda images: images[:, ::-1, ::-1])
    if size[0] == size[1]:
        yield Transform("transpose", "with x and y exchanged", lambda images: images.swapaxes(1, 2))
    for order in permutations(range(3)):
        if order != (0, 1, 2):
            names = "".join("RGB"[channel] for channel in np.argsort(order))
            yield Transform(f"channels {names}", f"with its channels in the order {names}",
                            lambda images, order=order: images[..., list(order)])  # type: ignore[misc]


def _scaled(flip: Transform, factor: float) -> Iterator[Transform]:
    if not np.isfinite(factor) or factor <= 0 or abs(factor - 1) < 1e-9:
        return
    near = min(FACTORS, key=lambda name: abs(FACTORS[name] / factor - 1))
    named = f" ({near})" if abs(FACTORS[near] / factor - 1) < NAMED else ""
    also = f", and {flip.told}" if flip.told else ""
    yield Transform(f"factor {factor:.4g} {flip.name}".strip(), f"{factor:.4g}{named} times as bright{also}",
                    lambda images: flip.undo(images) / factor, factor)


def shifted(fine: np.ndarray, shift: tuple[int, int]) -> np.ndarray:
    """A picture of twice the size, (2H, 2W, C), as one of pixels that lie half a pixel to the (right, down); pixels at
    the border that would lie outside take the border's own."""
    right, down = shift
    padded = np.pad(fine, ((1, 1), (1, 1), (0, 0)), mode="edge")
    rows, columns = fine.shape[:2]
    moved = padded[1 + down:1 + down + rows, 1 + right:1 + right + columns]
    return np.asarray(moved.reshape(rows // 2, 2, columns // 2, 2, -1).mean(axis=(1, 3)))


def told_shift(shift: tuple[int, int]) -> str:
    """A shift in words."""
    parts = [word for value, words in zip(shift, (("left", "right"), ("up", "down")), strict=True)
             if value for word in [words[value > 0]]]
    return f"half a pixel to the {' and '.join(parts)}"
