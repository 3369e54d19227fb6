"""Is a render biased anywhere? Equivalence of the whole image and of its tiles, under heavy and unequal tails."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from harness.errors import HarnessError
from harness.stats.bias import POWER, Outcome, check_tolerance, error_scale, percent, signed_percent
from harness.stats.channels import CHANNELS, Channel
from harness.stats.deviates import (
    all_exceed,
    critical_deviate,
    half_width,
    largest_deviate,
    one_sided,
    satterthwaite,
    skew_deviate,
    skew_interval,
    skew_student,
)
from harness.stats.levels import check_level, family_level
from harness.stats.tiles import COARSER, ImageMoments, TileMoments, TileSamples

# A tile darker than this part of the image's mean is measured against that part, not against its own near-zero mean.
DARK_TILE = 0.01
# Bright samples that a neighbourhood should expect: then e^-16 of them have seen none.
BRIGHT_SAMPLES = 16
# Neighbours lend each other the variance of a tile up to so many times as bright.
BRIGHTER = 2.0
# How many tests a `BiasVerdict` consists of: the image, larger tiles, smaller tiles.
TESTS = 3
# The first of these that one of several tests has is the outcome of all.
GRAVITY: tuple[Outcome, ...] = ("fail", "inconclusive", "pass")


@dataclass(frozen=True)
class Tolerance:
    """Relative bias that counts as none: of the image's mean, of a larger tile (1/5 of the image's side), of a smaller.

    The defaults are in balance: where pixels are equally noisy, all three need about the same samples to pass. The
    last is what a bias of 5 % in a square of 1 % of the image gives to some tile, wherever it lies (`tile_size`).
    """

    mean: float = 0.002
    coarse: float = 0.0125
    fine: float = 0.05


@dataclass(frozen=True, eq=False)
class TileVerdict:
    """Errors of the tiles of one size: arrays (rows, columns, 4), of red, green, blue and luminance.

    `error`: relative to the tile's reference mean, or to 1 % of the image's where the tile is darker; `low`, `high`:
    its own interval at confidence 1 - `pass_level`. `z`: error over its standard error, as a normal deviate, positive
    where the test is too bright. `critical`: the |z| that chance exceeds anywhere in the map with probability
    `fail_level`. `p`: the probability with which chance makes any tile exceed the tolerance as clearly as the worst
    did. `worst`: (row, column) of the tile with the largest |z|; its first pixel is `worst` times `tile`.
    `smallest_detectable`: by how much a tile's bias must exceed the tolerance to be found with probability 0.95;
    infinite where the variance is unknown.
    """

    outcome: Outcome
    reason: str
    tolerance: float
    fail_level: float
    pass_level: float
    tile: int
    error: np.ndarray
    low: np.ndarray
    high: np.ndarray
    z: np.ndarray
    p: float
    critical: float
    worst: tuple[int, int]
    smallest_detectable: np.ndarray


@dataclass(frozen=True, eq=False)
class BiasVerdict:
    """The verdict on an image: of the whole as a single tile, of the larger and of the smaller tiles.

    fail: one of them fails; pass: all pass; inconclusive otherwise. `reason` is that of the test that decides.
    """

    outcome: Outcome
    reason: str
    mean: TileVerdict
    coarse: TileVerdict
    fine: TileVerdict

    @property
    def luminance(self) -> tuple[float, float, float]:
        """Error, low and high of the image's mean luminance."""
        error, low, high = (float(values[0, 0, Channel.LUMINANCE])
                            for values in (self.mean.error, self.mean.low, self.mean.high))
        return error, low, high


def bias_verdict(test: TileSamples, reference: TileSamples, tolerance: Tolerance | None = None, *,
                 fail_level: float = 0.01, pass_level: float = 0.05) -> BiasVerdict:
    """Is the test equivalent to the reference as a whole and everywhere?

    The tiles of both are the smaller ones (see `tiles.tile_size`), with four channels. `fail_level`: the probability
    with which a good render fails at the most; the three tests share it (see `levels.family_level`). `pass_level`:
    twice the probability with which a render passes that is off by a tolerance; all three tests must pass, each at the
    full level (intersection-union test, Berger 1982). HarnessError for levels outside (0, 1), negative tolerances, and
    estimates with other tiles or sizes.
    """
    tolerance = tolerance or Tolerance()
    check_level(fail_level)
    each = family_level(fail_level, TESTS)
    whole, coarse, fine = (
        tile_verdict(ours, theirs, allowed, fail_level=each, pass_level=pass_level) for ours, theirs, allowed in (
            (test.whole(), reference.whole(), tolerance.mean),
            (test.coarser(COARSER), reference.coarser(COARSER), tolerance.coarse),
            (test, reference, tolerance.fine)))
    gravest = min((whole, coarse, fine), key=lambda verdict: GRAVITY.index(verdict.outcome))
    return BiasVerdict(gravest.outcome, gravest.reason, whole, coarse, fine)


def tile_verdict(test: TileSamples, reference: TileSamples, tolerance: float, *, fail_level: float = 0.01,
                 pass_level: float = 0.05) -> TileVerdict:
    """Equivalence test of each tile and channel against a reference rendered independently.

    A tile's true error exceeds the tolerance τ where T - (1 + τ) R > 0 or T - (1 - τ) R < 0 for the means T and R of
    test and reference: linear in both, so that their moments simply add.

    - fail: for some tile and channel one of these is significant, two-sided, at a level corrected for their number
      (Šidák 1967), so that a good render fails with probability at most `fail_level`; or a value is not finite.
    - pass: for every tile and channel the opposite of both is significant at `pass_level` / 2 (two one-sided tests,
      Schuirmann 1987; all must hold, so there is nothing to correct).
    - inconclusive: neither, or a variance is unknown.

    The deviates are those of `deviates.skew_deviate`, their variances borrow from the neighbours (`_borrowed`), so
    that the level holds also where one side draws rare bright samples and the other does not.
    """
    check_tolerance(tolerance)
    check_level(fail_level)
    check_level(pass_level)
    _check_alike(test, reference)
    pair = _Pair.of(test.moments(), reference.moments())
    outcome, p = _decided(pair, tolerance, fail_level, pass_level)
    difference, variance, _, dof = pair.excess(0.0)
    error, sigma = difference / pair.scale, np.sqrt(variance) / pair.scale
    cell = family_level(fail_level, error.size)
    detectable = half_width(sigma, dof, cell) + half_width(sigma, dof, 2 * (1 - POWER))
    low, high = _interval(pair, error, pass_level)
    z = skew_deviate(*pair.excess(0.0))
    above, below = (skew_deviate(*pair.excess(bound)) for bound in (tolerance, -tolerance))
    sure = critical_deviate(pass_level / 2)
    maps = _Maps(error, low, high, np.nan_to_num(np.maximum(above, -below), nan=-np.inf),
                 (-above >= sure) & (below >= sure))
    reason = _reason(outcome, test.tile, pair, maps, p, tolerance)
    row, column = np.unravel_index(int(np.argmax(np.abs(np.nan_to_num(z)))), z.shape)[:2]
    return TileVerdict(outcome, reason, tolerance, fail_level, pass_level, test.tile, error, low, high, z, p,
                       critical_deviate(cell / 2), (int(row), int(column)),
                       np.where(np.isnan(detectable), np.inf, detectable))


def bias_p_values(test: ImageMoments, reference: ImageMoments,
                  tolerance: Tolerance) -> tuple[float, float, float]:
    """The p of the three tests of `bias_verdict`, in its order, without the rest of it."""
    whole, coarse, fine = (_decided(pair, allowed, 0.5, 0.5)[1] for pair, allowed in _pairs(test, reference, tolerance))
    return whole, coarse, fine


def bias_outcome(test: ImageMoments, reference: ImageMoments, tolerance: Tolerance, *, fail_level: float,
                 pass_level: float) -> Outcome:
    """The outcome of `bias_verdict`, decided by the same code, without intervals, maps and words: in a tenth of the
    time, for those who simulate many."""
    each = family_level(fail_level, TESTS)
    outcomes = [_decided(pair, allowed, each, pass_level)[0] for pair, allowed in _pairs(test, reference, tolerance)]
    return min(outcomes, key=GRAVITY.index)


def _pairs(test: ImageMoments, reference: ImageMoments, tolerance: Tolerance) -> Iterator[tuple[_Pair, float]]:
    """Test and reference in tiles of each size, with what is tolerated there."""
    allowed = tolerance.mean, tolerance.coarse, tolerance.fine
    for ours, theirs, bound in zip(test, reference, allowed, strict=True):
        yield _Pair.of(ours, theirs), bound


class _Pair(NamedTuple):
    """Test and reference, their variances borrowed, and the scale of errors; see `TileVerdict.error`."""

    test: TileMoments
    reference: TileMoments
    test_variance: np.ndarray
    reference_variance: np.ndarray
    scale: np.ndarray

    @classmethod
    def of(cls, test: TileMoments, reference: TileMoments) -> _Pair:
        pixels = reference.pixels
        whole = error_scale((reference.mean * pixels).sum((0, 1)) / pixels.sum())
        single = reference.mean.shape[:2] == (1, 1)
        scale = whole[None, None] if single else np.maximum(np.abs(reference.mean), DARK_TILE * whole)
        return cls(test, reference, _borrowed(test, scale), _borrowed(reference, scale), scale)

    def excess(self, error: float | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Value, second and third moment and degrees of freedom of T - (1 + error) R: zero if that is the error."""
        factor = np.where(self.scale == np.abs(self.reference.mean), 1 + error, 1.0)
        theirs = factor**2 * self.reference_variance
        variance = self.test_variance + theirs
        dof = satterthwaite(variance, self.test_variance**2 / self.test.dof + theirs**2 / self.reference.dof)
        return (self.test.mean - self.reference.mean - error * self.scale, variance,
                self.test.third - factor**3 * self.reference.third, dof)


class _Maps(NamedTuple):
    """What `_reason` goes by, arrays (rows, columns, 4)."""

    error: np.ndarray
    low: np.ndarray
    high: np.ndarray
    beyond: np.ndarray  # deviate of the excess over the tolerance
    equivalent: np.ndarray


def _borrowed(moments: TileMoments, scale: np.ndarray) -> np.ndarray:
    """Variances no smaller than the mean of those around; (rows, columns, C).

    A tile in which the rare bright sample has not come yet has a mean that is too low and a variance that knows
    nothing of it. Its neighbours see the same light and know. Asked for 5 % at the most, the smaller tiles of
    `spheres` at 128 samples per pixel, uniform sampling against the mixture, alarm on 60 of 100 null comparisons
    without this and on none with it. (No method helps where bright samples fall on one tile alone that has seen none.)
    Two neighbourhoods count, 3 x 3 tiles and one that holds `BRIGHT_SAMPLES`: were all variance from bright samples, a
    tile's mean with skewness g would come from 1/g² of them. Averaged is the variance of one pixel; at the most it is
    what a tile `BRIGHTER` times as bright would have of the neighbours' relative variance, lest a lamp blind the tiles
    beside it.
    """
    if moments.variance.shape[:2] == (1, 1):
        return moments.variance
    single = moments.variance * moments.pixels
    third = np.abs((moments.third * moments.pixels**2 / scale**3).mean((0, 1)))
    mean = (single / scale**2).mean((0, 1))
    known = np.isfinite(mean) & (mean > 0)
    skewness = np.divide(third, mean**1.5, out=np.zeros_like(mean), where=known) / np.sqrt(moments.pixels.max())
    radius = max(1, math.ceil((math.sqrt(BRIGHT_SAMPLES) * float(skewness.max()) - 1) / 2))
    relative = single / scale**2
    floors = [np.minimum(_around(single, each), (BRIGHTER * scale)**2 * _around(relative, each))
              for each in {1, radius}]
    # Differences of sums may fall below zero by rounding; no variance does.
    return np.maximum.reduce([moments.variance, *(floor / moments.pixels for floor in floors)])


def _around(values: np.ndarray, radius: int) -> np.ndarray:
    """Means over windows of 2 `radius` + 1 tiles a side, which are shifted inwards at the edges; (rows, columns, C)."""
    for axis in (0, 1):
        length = values.shape[axis]
        side = min(2 * radius + 1, length)
        first = np.clip(np.arange(length) - radius, 0, length - side)
        sums = np.concatenate([np.zeros_like(values.take([0], axis)), values.cumsum(axis)], axis)
        values = (sums.take(first + side, axis) - sums.take(first, axis)) / side
    return values


def _interval(pair: _Pair, error: np.ndarray, alpha: float) -> tuple[np.ndarray, np.ndarray]:
    """The interval of each error, to first order in the reference's noise (delta method)."""
    _, variance, third, dof = pair.excess(error)
    return skew_interval(error, variance / pair.scale**2, third / pair.scale**3, dof, alpha)


def _family_p(deviate: float, cells: int) -> float:
    """Two-sided p-value of the largest of so many deviates (Šidák)."""
    return float(-np.expm1(cells * np.log1p(-min(2 * one_sided(deviate), 1 - 1e-16))))


def _decided(pair: _Pair, tolerance: float, fail_level: float, pass_level: float) -> tuple[Outcome, float]:
    """The outcome of `tile_verdict`, and its p."""
    (above, dof), (below, dof_below) = (_student(pair, bound) for bound in (tolerance, -tolerance))
    dofs = np.stack([dof, dof_below])
    p = _family_p(largest_deviate(np.stack([above, -below]), dofs), above.size)
    if not np.isfinite(pair.test.mean).all():
        return "fail", p
    if not all(np.isfinite(values).all() for values in (pair.reference.mean, pair.test.variance,
                                                        pair.reference.variance)):
        return "inconclusive", p
    if p < fail_level:
        return "fail", p
    equivalent = all_exceed(np.stack([-above, below]), dofs, critical_deviate(pass_level / 2))
    return ("pass" if equivalent else "inconclusive"), p


def _student(pair: _Pair, error: float) -> tuple[np.ndarray, np.ndarray]:
    """The excess over an error, studentized, and its degrees of freedom."""
    difference, variance, third, dof = pair.excess(error)
    return skew_student(difference, variance, third), dof


def _reason(outcome: Outcome, tile: int, pair: _Pair, maps: _Maps, p: float, tolerance: float) -> str:
    for name, side in (("test image", pair.test), ("reference", pair.reference)):
        broken = np.argwhere(~np.isfinite(side.mean))
        if broken.size:
            message = f"the {name} holds pixels that are not finite, in {_place(broken[0], tile, maps)}"
            return message if side is pair.test else f"{message}; render it again"
    for name, side in (("test image", pair.test), ("reference", pair.reference)):
        if not np.isfinite(side.variance).all():
            return f"the variance of the {name} is unknown: it takes two batches or more"

    def told(index: tuple[np.intp, ...]) -> str:
        return (f"{_place(index, tile, maps)}: {CHANNELS[index[-1]]} {signed_percent(maps.error[index])} "
                f"[{signed_percent(maps.low[index])}, {signed_percent(maps.high[index])}]")

    band = f"±{percent(tolerance)}"
    if outcome == "fail":
        clearest = np.unravel_index(int(np.argmax(maps.beyond)), maps.beyond.shape)
        return f"{told(clearest)} lies outside {band}, by chance with probability {p:.1g}"
    reach = np.maximum(np.abs(maps.low), np.abs(maps.high))
    widest = told(np.unravel_index(int(np.argmax(reach)), reach.shape))
    if outcome == "pass":
        return f"every value lies within {band}; the widest interval is that of {widest}"
    return (f"{int((~maps.equivalent).sum())} of {maps.equivalent.size} values may lie outside {band}, first of all "
            f"{widest}; draw more samples")


def _place(index: Sequence[np.intp] | np.ndarray, tile: int, maps: _Maps) -> str:
    if maps.error.shape[:2] == (1, 1):
        return "the image"
    return f"the tile at x={int(index[1]) * tile}, y={int(index[0]) * tile}"


def _check_alike(test: TileSamples, reference: TileSamples) -> None:
    ours, theirs = ((side.tile, side.height, side.width, side.channels) for side in (test, reference))
    if ours != theirs or ours[-1] != len(CHANNELS):
        raise HarnessError(f"expected two estimates with equal tiles, sizes and {len(CHANNELS)} channels, found (tile, "
                           f"height, width, channels) {ours} and {theirs}")
