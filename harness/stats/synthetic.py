"""Estimators without a renderer: batches of known mean whose samples have light, heavy and very heavy tails."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from harness.errors import HarnessError
from harness.stats.tiles import TileSamples, tile_size

# Fireflies: one sample in so many is so much brighter than the rest together are on average.
RARITY, BRIGHTNESS = 1e-4, 1000.0
# Standard deviation of the logarithm of a lognormal sample; its relative standard deviation is 7.3.
LOGNORMAL_SIGMA = 2.0
# Length of the list that sums of lognormal samples are drawn from.
LIST = 1 << 18

# Relative noise with mean zero, for B batches of n samples a tile: (rng, n, (B, rows, columns)) -> the same, and (4,).
Noise = Callable[[np.random.Generator, int, tuple[int, int, int]], np.ndarray]


@dataclass(frozen=True)
class Plan:
    """An image of `side` x `side` pixels in `batches` batches of `spp` samples per pixel.

    `side` must be a multiple of 20 such that all tiles are equal; HarnessError else.
    """

    side: int = 60
    batches: int = 32
    spp: int = 8

    def __post_init__(self) -> None:
        if self.side % 20 or self.side % self.tile:
            raise HarnessError(f"a synthetic image has equal tiles for sides that are multiples of 20, found "
                               f"{self.side}")

    @property
    def tile(self) -> int:
        return tile_size(self.side, self.side)


def normal(rng: np.random.Generator, n: int, shape: tuple[int, int, int]) -> np.ndarray:
    """Samples with relative standard deviation 1, independent in red, green and blue."""
    rgb = rng.standard_normal((*shape, 3)) / np.sqrt(n)
    return np.concatenate([rgb, rgb.mean(axis=-1, keepdims=True)], axis=-1)


def fireflies(rng: np.random.Generator, n: int, shape: tuple[int, int, int]) -> np.ndarray:
    """Normal samples, and white ones that are `BRIGHTNESS` times as bright with probability `RARITY`."""
    rare = BRIGHTNESS * (rng.binomial(n, RARITY, shape) / n - RARITY)
    return normal(rng, n, shape) + rare[..., None]


def lognormal(rng: np.random.Generator, n: int, shape: tuple[int, int, int]) -> np.ndarray:
    """White lognormal samples; sums of them are drawn with replacement from one list, whose mean is known exactly."""
    return np.repeat(rng.choice(_lognormal_means(n), shape)[..., None], 4, axis=-1)


@functools.lru_cache(maxsize=4)
def _lognormal_means(n: int) -> np.ndarray:
    """`LIST` means of n lognormal samples each, relative to the mean of all, less one."""
    rng, sums = np.random.default_rng(n), np.zeros(LIST)
    for _ in range(n):
        sums += np.exp(LOGNORMAL_SIGMA * rng.standard_normal(LIST))
    return sums / sums.mean() - 1


NOISES: dict[str, Noise] = {"normal": normal, "lognormal": lognormal, "fireflies": fireflies}


def draw(noise: Noise, plan: Plan, rng: np.random.Generator) -> TileSamples:
    """One estimate of an image whose brightness grows tenfold from left to right."""
    across = plan.side // plan.tile
    truth = np.broadcast_to(np.geomspace(0.2, 2.0, across)[:, None], (across, across, 4))
    relative = noise(rng, plan.tile**2 * plan.spp, (plan.batches, across, across))
    return TileSamples(truth * (1 + relative), np.full(plan.batches, plan.spp), plan.tile, plan.side, plan.side)


def with_gain(samples: TileSamples, gain: float, patch: tuple[int, int, int] | None = None) -> TileSamples:
    """The same, brighter by the relative `gain`, everywhere or in a square patch (first row, first column, side).

    A tile that the patch covers in part is brighter by that part of the gain, as it is where radiance is even. Tiles
    without noise keep their value: there light is seen directly, which shading does not touch, and any gain would
    give itself away.
    """
    if patch is None:
        covered = np.ones(samples.means.shape[1:3])
    else:
        row, column, side = patch
        rows, columns = (
            np.clip(np.minimum(ends, first + side) - np.maximum(ends - samples.tile, first), 0, None)
            / np.minimum(samples.tile, length - ends + samples.tile)
            for first, length in ((row, samples.height), (column, samples.width))
            for ends in [samples.tile * (1 + np.arange(-(-length // samples.tile)))])
        covered = np.multiply.outer(rows, columns)
    noisy = (samples.means != samples.means[:1]).any(axis=0)
    means = samples.means * (1 + gain * covered[..., None] * noisy)
    return dataclasses.replace(samples, means=means)
