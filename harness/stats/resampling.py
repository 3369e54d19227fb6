"""Runs that might have been: drawn from a bank of an estimator's replicas, as the moments that verdicts look at."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from harness.stats.contrasts import PairedContrast, PairedMoments
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


def mirrored(test: TileSamples, reference: TileSamples) -> tuple[TileSamples, TileSamples]:
    """A coupled bank in which each pair comes twice, with its difference and with the opposite: all differences then
    have mean zero, and keep their size and their tails.

    `centred` would take a bank's rare parting from all other replicas of its tile, so that most runs, which do not draw
    it, were sure of a bias of its size: a null that right renderers do not have, whose partings go to both sides.
    """
    differences = test.means - reference.means
    twice = np.tile(np.arange(len(test.samples)), 2)
    ours, theirs = test.chosen(twice), reference.chosen(twice)
    means = np.concatenate([test.means, reference.means - differences])
    return dataclasses.replace(ours, means=means), theirs


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


def resampled_pairs(test: TileSamples, reference: TileSamples, chosen: np.ndarray,
                    largest: tuple[np.ndarray, ...],
                    unseen_level: float | None = None) -> Iterator[tuple[PairedContrast, ...]]:
    """The contrasts of each run of coupled estimates, which consists of pairs of replicas `chosen` (runs, replicas).

    The same as `paired.paired` of just these, but that a single sample is no larger than `largest`, of the whole bank
    (`paired.largest_by_size`), in every run.
    """
    if not chosen.size:
        return
    counts = np.zeros((len(chosen), len(test.samples)))
    np.add.at(counts, (np.arange(len(chosen))[:, None], chosen), 1)
    banks = ((test.whole(), reference.whole()), (test.coarser(COARSER), reference.coarser(COARSER)), (test, reference))
    sides = (_paired_moments(*pair, counts) for pair in banks)
    for moments in zip(*sides, strict=True):
        yield tuple(PairedContrast.of(each, bound, unseen_level)
                    for each, bound in zip(moments, largest, strict=True))


def _paired_moments(test: TileSamples, reference: TileSamples, counts: np.ndarray) -> Iterator[PairedMoments]:
    """`PairedMoments.of` for each row of `counts`, as `_moments` has those of one side."""
    number, shape, pixels = counts[0].sum(), test.means.shape[1:], test.pixels
    samples = float(number * test.samples[0])
    means = reference.means, test.means - reference.means
    centres = [values.mean(axis=0) for values in means]
    m, d = ((values - centre).reshape(len(counts[0]), -1) for values, centre in zip(means, centres, strict=True))
    m1, d1 = counts @ m / number, counts @ d / number
    raw = {name: counts @ powers / number for name, powers in {
        "dd": d * d, "dm": d * m, "mm": m * m, "ddd": d**3, "ddm": d * d * m, "dmm": d * m * m, "mmm": m**3}.items()}
    seconds = np.stack([raw["dd"] - d1 * d1, raw["dm"] - d1 * m1, raw["mm"] - m1 * m1], axis=1) / (number - 1)
    thirds = np.stack([
        raw["ddd"] - 3 * d1 * raw["dd"] + 2 * d1**3,
        raw["ddm"] - m1 * raw["dd"] - 2 * d1 * raw["dm"] + 2 * d1 * d1 * m1,
        raw["dmm"] - d1 * raw["mm"] - 2 * m1 * raw["dm"] + 2 * d1 * m1 * m1,
        raw["mmm"] - 3 * m1 * raw["mm"] + 2 * m1**3], axis=1) / (number * (number - 3 + 2 / number))
    seconds[:, [0, 2]] = np.maximum(seconds[:, [0, 2]], 0.0)
    for run, (second, third) in enumerate(zip(seconds, thirds, strict=True)):
        dd, dm, mm = (values.reshape(shape) for values in second)
        ddd, ddm, dmm, mmm = (values.reshape(shape) for values in third)
        theirs = TileMoments(centres[0] + m1[run].reshape(shape), mm, mmm, number - 1, pixels)
        ours = TileMoments(theirs.mean + centres[1] + d1[run].reshape(shape), dd + 2 * dm + mm,
                           ddd + 3 * ddm + 3 * dmm + mmm, number - 1, pixels)
        yield PairedMoments(ours, theirs, np.stack([dd, dm, mm]), np.stack([ddd, ddm, dmm, mmm]), samples)


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
