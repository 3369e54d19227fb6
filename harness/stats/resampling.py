"""Runs that might have been: drawn from a bank of an estimator's replicas, as the moments that verdicts look at."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from harness.stats.tiles import COARSER, PATCH, ImageMoments, TileMoments, TileSamples

# A square patch of an image: first row, first column, side, in pixels.
Patch = tuple[int, int, int]


def draws(size: int, replicas: int, runs: int, stream: int) -> np.ndarray:
    """Which of a bank's `size` replicas each of so many runs draws, (runs, replicas) whole numbers.

    With replacement (the bootstrap, Efron 1979): a run is then an independent sample of a population whose mean is
    known, namely the bank's, so that the null hypothesis holds exactly and mean and variance err together as they do in
    a real run. Without replacement, n of N replicas would scatter about that mean with only the part 1 - n/N of the
    variance that their own scatter tells of, and false alarms would seem rarer than they are. A bright sample that
    the bank holds once is missing from a run with probability exp(-n/N), as one that comes once in N replicas is; of
    what is rarer the bank knows nothing. Runs of one `stream` draw the same numbers whatever `replicas` is, up to it.
    """
    return np.random.default_rng([stream, size]).integers(size, size=(replicas, runs)).T


def centred(bank: TileSamples, truth: np.ndarray) -> TileSamples:
    """The bank moved tile by tile such that its mean is `truth`, (rows, columns, C).

    Deviations from the bank's own mean are too small by the factor (N - 1)/N in their variance, which is made up for.
    Where all replicas agree there is no noise, and they stay in agreement.
    """
    replicas = len(bank.samples)
    mean = bank.means.mean(axis=0)
    away = np.where(noisy(bank), bank.means - mean, 0.0) * np.sqrt(replicas / (replicas - 1))
    return dataclasses.replace(bank, means=truth + away)


def noisy(bank: TileSamples) -> np.ndarray:
    """Which tiles and channels differ between replicas, (rows, columns, C): the others show light directly."""
    return np.asarray((bank.means != bank.means[:1]).any(axis=0))


def resampled(bank: TileSamples, chosen: np.ndarray) -> Iterator[ImageMoments]:
    """The moments of each run, which consists of the replicas `chosen` (runs, replicas); the same as of a `TileSamples`
    of just these, at a hundredth of the cost. An exact bank is the same in all runs."""
    if not chosen.size:
        return
    if bank.samples.sum() == 0:
        exact = ImageMoments.of(bank)
        yield from (exact for _ in chosen)
        return
    counts = np.zeros((len(chosen), len(bank.samples)))
    np.add.at(counts, (np.arange(len(chosen))[:, None], chosen), 1)
    sides = (_moments(side, counts) for side in (bank.whole(), bank.coarser(COARSER), bank))
    yield from (ImageMoments(*moments) for moments in zip(*sides, strict=True))


def _moments(bank: TileSamples, counts: np.ndarray) -> Iterator[TileMoments]:
    """`TileSamples.moments` for each row of `counts`, which says how often each of the equal batches was drawn."""
    number, shape, pixels = counts[0].sum(), bank.means.shape[1:], bank.pixels
    centre = bank.means.mean(axis=0)
    away = np.where(noisy(bank), bank.means - centre, 0.0).reshape(len(bank.samples), -1)
    squares = away * away
    first, second, third = (counts @ powers / number for powers in (away, squares, squares * away))
    variances = np.maximum(second - first**2, 0.0) / (number - 1)
    thirds = (third - 3 * first * second + 2 * first**3) / (number * (number - 3 + 2 / number))
    for mean, variance, skew in zip(first, variances, thirds, strict=True):
        yield TileMoments(centre + mean.reshape(shape), variance.reshape(shape), skew.reshape(shape), number - 1,
                          pixels)


def shaded_patches(bank: TileSamples, count: int, rng: np.random.Generator) -> list[Patch]:
    """So many squares of 1 % of the image at random, among those that cover noisy tiles alone or, failing that, most.

    What is seen directly is no shading: a defect there would give itself away.
    """
    side = max(1, int(np.sqrt(PATCH * bank.height * bank.width)))
    mask = noisy(bank).any(axis=-1).repeat(bank.tile, axis=0).repeat(bank.tile, axis=1)[:bank.height, :bank.width]
    sums = np.pad(mask.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    covered = sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side]
    places = np.argwhere(covered == covered.max())
    return [(int(row), int(column), side) for row, column in rng.choice(places, count)]
