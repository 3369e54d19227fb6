"""What bias tests see of an image: the means of its tiles in every batch, and from them three moments."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

# A square patch of this part of the image is what the smaller tiles are made to find.
PATCH = 0.01
# How many of the smaller tiles a larger one holds along each side; see `tile_size`.
COARSER = 4
# Their sides, and those of the larger ones, as parts of the image's.
SMALLER = PATCH**0.5 / 2
LARGER = COARSER * SMALLER
# Batches that an accumulator keeps before it merges neighbours: more add no degrees of freedom that matter.
MAX_BATCHES = 256


@dataclass(frozen=True, eq=False)
class TileMoments:
    """Estimates for each tile and channel, arrays (rows, columns, C): the mean, and the mean's own second and third
    central moments; NaN where too few batches tell. `dof`: degrees of freedom of the variance; infinite if exact.
    `pixels`: (rows, columns, 1), how many pixels a tile has; fewer at the right and bottom edges.
    """

    mean: np.ndarray
    variance: np.ndarray
    third: np.ndarray
    dof: float
    pixels: np.ndarray


@dataclass(frozen=True, eq=False)
class TileSamples:
    """The batches of one estimate of one image, each reduced to the means of tiles of `tile` x `tile` pixels.

    `means`: (B, rows, columns, C). `samples`: (B,), samples per pixel of each batch; a single batch of zero samples is
    an exact image. `height`, `width`: of the image, in pixels. Batches must be independent and should be about equal in
    size, 32 of them or more; from as few as 8 skewness is guesswork, and tiles take more than 1.4 times the
    tolerance to pass that they take from 16.

    `brightest`: (B, rows, columns, C), what no single sample of the batch exceeds in the tile, in radiance: the largest
    sample where the renderer keeps it, else the largest sum of samples in any of its pixels, for radiance is not
    negative. None where nobody kept it.
    """

    means: np.ndarray
    samples: np.ndarray
    tile: int
    height: int
    width: int
    brightest: np.ndarray | None = None

    @classmethod
    def exact(cls, image: np.ndarray, tile: int) -> TileSamples:
        """A closed-form image (H, W, C) as samples without noise."""
        return cls(tile_means(image, tile)[None], np.zeros(1), tile, *image.shape[:2])

    @property
    def pixels(self) -> np.ndarray:
        """Pixels of each tile, (rows, columns, 1)."""
        rows, columns = (np.diff([*range(0, size, self.tile), size]) for size in (self.height, self.width))
        return np.multiply.outer(rows, columns)[..., None].astype(np.float64)

    @property
    def channels(self) -> int:
        """How many channels the image has."""
        return self.means.shape[-1]

    def coarser(self, factor: int) -> TileSamples:
        """The same in tiles of `factor` times the side."""
        return self._regrouped(factor, factor * self.tile)

    def whole(self) -> TileSamples:
        """The same with the whole image as its one tile."""
        side = max(self.height, self.width)
        return self._regrouped(-(-side // self.tile), side)

    def first(self, batches: int) -> TileSamples:
        """The first so many batches alone."""
        return self.chosen(np.s_[:batches])

    def chosen(self, batches: slice | np.ndarray) -> TileSamples:
        """These batches alone, in this order; one may come twice."""
        return TileSamples(self.means[batches], self.samples[batches], self.tile, self.height, self.width,
                           None if self.brightest is None else self.brightest[batches])

    def moments(self) -> TileMoments:
        """Mean and the mean's central moments by batch means, weighted by samples.

        For a batch of n of all N samples the mean m has variance σ²/n and third central moment κ/n². Hence, with B
        batches, Σ n (m - m̄)² / (B - 1) estimates σ², and Σ n² (m - m̄)³ / (B - 3 + 2 Σ (n/N)²) estimates κ, both
        without bias also for unequal batches; the mean of all has σ²/N and κ/N².
        """
        batches, total = len(self.samples), float(self.samples.sum())
        if total == 0:
            zero = np.zeros(self.means.shape[1:])
            return TileMoments(self.means[0], zero, zero, np.inf, self.pixels)
        weights = (self.samples / total)[:, None, None, None]
        with np.errstate(invalid="ignore"):  # of values that are not finite, whose tile is judged by that
            mean = (weights * self.means).sum(axis=0)
            mean[~np.isfinite(mean)] = np.nan
            away = self.means - mean
            squares = weights * away * away
            second, third = squares.sum(axis=0), (weights * squares * away).sum(axis=0)
        divisor = batches - 3 + 2 * float((weights**2).sum())
        return TileMoments(mean, second / (batches - 1) if batches > 1 else np.full_like(mean, np.nan),
                           third / divisor if batches > 2 else np.zeros_like(mean), batches - 1, self.pixels)

    def _regrouped(self, factor: int, tile: int) -> TileSamples:
        pixels = self.pixels
        sums = grouped(self.means * pixels, factor)
        means = sums / grouped(pixels[None], factor)
        brightest = None if self.brightest is None else grouped(self.brightest, factor, np.maximum)
        return TileSamples(means, self.samples, tile, self.height, self.width, brightest)


class ImageMoments(NamedTuple):
    """The moments of one estimate in tiles of the three sizes that a verdict looks at."""

    whole: TileMoments
    coarse: TileMoments
    fine: TileMoments

    @classmethod
    def of(cls, samples: TileSamples) -> ImageMoments:
        """Those of all batches of an estimate in the smaller tiles."""
        return cls(samples.whole().moments(), samples.coarser(COARSER).moments(), samples.moments())


class TileAccumulator:
    """Collects the batches of one estimate as tile means.

    Memory is bounded: of more than `MAX_BATCHES`, neighbours are merged two by two.
    """

    def __init__(self, tile: int) -> None:
        self.tile = tile
        self._shape = (0, 0)
        self._means: list[np.ndarray] = []
        self._samples: list[float] = []
        self._brightest: list[np.ndarray] = []

    def add(self, mean: np.ndarray, samples: int, largest: np.ndarray | None = None) -> None:
        """One batch: its mean image (H, W, C), its samples per pixel and, if known, the largest single sample of each
        pixel, shaped as the mean. ValueError for no samples, or another size."""
        if samples < 1:
            raise ValueError(f"expected at least 1 sample, found {samples}")
        if self._means and mean.shape[:2] != self._shape:
            raise ValueError(f"expected an image of {self._shape}, found {mean.shape[:2]}")
        self._shape = (mean.shape[0], mean.shape[1])
        self._means.append(tile_means(mean, self.tile))
        self._samples.append(float(samples))
        bound = np.abs(mean, dtype=np.float64) if largest is None else np.asarray(largest, dtype=np.float64)
        brightest = grouped(bound[None], self.tile, np.maximum)[0]
        self._brightest.append(brightest * samples if largest is None else brightest)
        if len(self._samples) > MAX_BATCHES:
            self._means = [np.average(self._means[k:k + 2], axis=0, weights=self._samples[k:k + 2])
                           for k in range(0, len(self._samples), 2)]
            self._samples = [sum(self._samples[k:k + 2]) for k in range(0, len(self._samples), 2)]
            self._brightest = [np.max(self._brightest[k:k + 2], axis=0) for k in range(0, len(self._brightest), 2)]

    def samples(self) -> TileSamples:
        """All that was added; ValueError when nothing was."""
        if not self._means:
            raise ValueError("no batch to estimate from")
        return TileSamples(np.stack(self._means), np.array(self._samples), self.tile, *self._shape,
                           np.stack(self._brightest))


def tile_size(height: int, width: int) -> int:
    """The side of the smaller tiles of an image, in pixels: the largest of which any square patch of 1 % of the image,
    wherever it lies, holds one whole (its side is at least twice the tile's, less a pixel).

    A bias in such a patch then shows in some tile undiluted. Tiles of `COARSER` times the side, 1/5 of the image's, are
    for defects of an object's size: of the noise of the smaller ones they have a quarter.
    """
    return max(1, (int(np.sqrt(PATCH * height * width)) + 1) // 2)


def tile_sums(image: np.ndarray, tile: int) -> np.ndarray:
    """Sums over tiles of `tile` x `tile` pixels, (H, W, ...) -> (ceil(H/tile), ceil(W/tile), ...)."""
    rows, columns = (np.arange(0, size, tile) for size in image.shape[:2])
    return np.add.reduceat(np.add.reduceat(image, rows, axis=0), columns, axis=1)


def tile_means(image: np.ndarray, tile: int) -> np.ndarray:
    """Means over tiles, in float64: (H, W, C) -> (rows, columns, C)."""
    image = np.asarray(image, dtype=np.float64)
    return tile_sums(image, tile) / _pixels(*image.shape[:2], tile)


@lru_cache(maxsize=64)
def _pixels(height: int, width: int, tile: int) -> np.ndarray:
    """Of each tile, (rows, columns, 1)."""
    found = tile_sums(np.ones((height, width, 1)), tile)
    found.flags.writeable = False
    return found


def grouped(values: np.ndarray, factor: int, together: np.ufunc = np.add) -> np.ndarray:
    """Sums, or what else is taken `together`, over blocks of `factor` x `factor` in axes 1 and 2."""
    rows, columns = (np.arange(0, size, factor) for size in values.shape[1:3])
    return np.asarray(together.reduceat(together.reduceat(values, rows, axis=1), columns, axis=2))
