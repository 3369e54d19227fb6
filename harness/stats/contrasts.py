"""What verdicts ask of a test and its reference: T - (1 + error) R of their means in tiles, and how sure it is."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from harness.stats.bias import error_scale
from harness.stats.deviates import half_width, satterthwaite, skew_interval
from harness.stats.tiles import ImageMoments, TileMoments, TileSamples

# A tile darker than this part of the image's mean is measured against that part, not against its own near-zero mean.
DARK_TILE = 0.01
# Bright samples that a neighbourhood should expect: then e^-16 of them have seen none.
BRIGHT_SAMPLES = 16
# Neighbours lend each other the variance of a tile up to so many times as bright.
BRIGHTER = 2.0


class Excess(NamedTuple):
    """Value, variance, third central moment and degrees of freedom of T - (1 + error) R, arrays (rows, columns, C);
    the value is zero where `error` is the true one, but for chance."""

    value: np.ndarray
    variance: np.ndarray
    third: np.ndarray
    dof: np.ndarray


@dataclass(frozen=True, eq=False)
class Contrast(ABC):
    """Test and reference in tiles of one size: arrays (rows, columns, C).

    `scale`: what errors are relative to; see `verdicts.TileVerdict.error`. `single`: the most that one sample can make
    of a tile's error where samples go in pairs, zero where they do not; see `unseen`.
    """

    test: TileMoments
    reference: TileMoments
    scale: np.ndarray
    single: np.ndarray

    @abstractmethod
    def excess(self, error: float | np.ndarray) -> Excess:
        """T - (1 + error) R; `error` a number or an array (rows, columns, C)."""

    def interval(self, pass_level: float) -> tuple[np.ndarray, np.ndarray]:
        """The interval of each error at confidence 1 - `pass_level`, to first order in the reference's noise (delta
        method)."""
        error = self.excess(0.0).value / self.scale
        _, variance, third, dof = self.excess(error)
        return skew_interval(error, variance / self.scale**2, third / self.scale**3, dof, pass_level)

    def unseen(self, pass_level: float) -> np.ndarray:
        """The bias that samples may hide which have not come yet, where none at all was seen to differ.

        Of n samples none was of a kind that comes with probability p: that has probability (1 - p)^n, so p is at most
        -ln(α)/n at level α (the rule of three, -ln 0.05 = 3.0; Hanley and Lippman-Hand 1983, "If nothing goes wrong, is
        everything all right?", JAMA 249). One such sample makes no more than M/n of the mean, all of them no more than
        -ln(α) M/n. The level is that of one side of the interval, `pass_level` / 2.
        """
        return -math.log(pass_level / 2) * self.single


@dataclass(frozen=True, eq=False)
class IndependentContrast(Contrast):
    """Of estimates with random numbers of their own: variances add, each borrowed from neighbours (`borrowed`)."""

    test_variance: np.ndarray
    reference_variance: np.ndarray

    @classmethod
    def of(cls, test: TileMoments, reference: TileMoments) -> IndependentContrast:
        """From the moments of both."""
        scale = scale_of(reference)
        return cls(test, reference, scale, np.zeros_like(scale), borrowed(test, scale), borrowed(reference, scale))

    def excess(self, error: float | np.ndarray) -> Excess:
        factor = np.where(self.scale == np.abs(self.reference.mean), 1 + error, 1.0)
        theirs = factor**2 * self.reference_variance
        variance = self.test_variance + theirs
        dof = satterthwaite(variance, self.test_variance**2 / self.test.dof + theirs**2 / self.reference.dof)
        return Excess(self.test.mean - self.reference.mean - error * self.scale, variance,
                      self.test.third - factor**3 * self.reference.third, dof)


@dataclass(frozen=True, eq=False)
class PairedMoments:
    """Of estimates whose batches go in pairs: the moments of both sides, and those that their means have together.

    `seconds`: (3, rows, columns, C), central, of DD, DM and MM, where D is the difference of the two means and M that
    of the reference; `thirds`: (4, rows, columns, C), of DDD, DDM, DMM and MMM. `samples`: per pixel, of each side.
    """

    test: TileMoments
    reference: TileMoments
    seconds: np.ndarray
    thirds: np.ndarray
    samples: float

    @classmethod
    def of(cls, test: TileSamples, reference: TileSamples) -> PairedMoments:
        """By batch means as `TileSamples.moments` has them, each weighted by its samples."""
        batches, total = len(test.samples), float(test.samples.sum())
        weights = (test.samples / total)[:, None, None, None]
        with np.errstate(invalid="ignore"):  # of values that are not finite, whose tile is judged by that
            d, m = (values - (weights * values).sum(axis=0) for values in (test.means - reference.means,
                                                                           reference.means))
            wd, wm = weights * d, weights * m
            seconds = np.stack([(wd * d).sum(0), (wd * m).sum(0), (wm * m).sum(0)])
            dd, mm = wd * wd, wm * wm
            thirds = np.stack([(dd * d).sum(0), (dd * m).sum(0), (mm * d).sum(0), (mm * m).sum(0)])
        divisor = batches - 3 + 2 * float((weights**2).sum())
        return cls(test.moments(), reference.moments(),
                   seconds / (batches - 1) if batches > 1 else np.full_like(seconds, np.nan),
                   thirds / divisor if batches > 2 else np.zeros_like(thirds), total)

    @property
    def differences(self) -> TileMoments:
        """Those of D."""
        mean = self.test.mean - self.reference.mean
        return TileMoments(mean, self.seconds[0], self.thirds[0], self.test.dof, self.test.pixels)


@dataclass(frozen=True, eq=False)
class PairedContrast(Contrast):
    """Of estimates from the same random numbers: batch k of the one belongs to batch k of the other.

    The moments are those of the batches' own D - error M: no covariance is assumed, and none left out. `lent`: what
    neighbours add to the variance of D (`borrowed`). `unseen_level`: in place of the interval's, see `unseen`.
    """

    moments: PairedMoments
    lent: np.ndarray
    unseen_level: float | None = None

    @classmethod
    def of(cls, moments: PairedMoments, largest: np.ndarray, unseen_level: float | None = None) -> PairedContrast:
        """From the moments of both; `largest` (rows, columns, C): what one sample is at the most, in radiance."""
        scale, differences = scale_of(moments.reference), moments.differences
        single = largest / (differences.pixels * moments.samples * scale)
        return cls(moments.test, moments.reference, scale, single, moments,
                   borrowed(differences, scale) - differences.variance, unseen_level)

    def unseen(self, pass_level: float) -> np.ndarray:
        """As of every contrast, but at `unseen_level` where there is one: looks need not share what they spend on it.

        What n samples have not shown, fewer had not shown either: a bias that hides at a later look has hidden at all
        before it. One that comes with probability p and would pass from n samples on, p n >= -ln(α), hides from these
        with probability e^(-p n) <= α, at how many looks ever.
        """
        return super().unseen(self.unseen_level or pass_level)

    def interval(self, pass_level: float) -> tuple[np.ndarray, np.ndarray]:
        """As of every contrast, but that the noise is one of jumps no larger than M, of which some were seen.

        A bias e away from the one seen, d, comes from jumps that came too seldom, and these have a variance of their
        own, of (e - d) M/n at the most. So (e - d)² = t² (V + (e - d) M/n) where e is just not rejected: Wilson's
        (1927) score interval, for jumps of several sizes. Where nothing was seen that gives t² M/n for the rule of
        three's -ln(α) M/n; the latter, `unseen`, is exact, and stands in its place: e - d = u/2 + √(t² V + u²/4). For
        jumps of one size that is within a tenth of a jump of the exact interval of a Poisson mean (Garwood 1936).
        Hall's correction knows no M, and would be up to twice as wide.
        """
        error = self.excess(0.0).value / self.scale
        _, variance, _, dof = self.excess(error)
        unseen = self.unseen(pass_level)
        seen = half_width(np.sqrt(variance) / self.scale, dof, pass_level)
        away = unseen / 2 + np.hypot(seen, unseen / 2)
        return error - away, error + away

    def excess(self, error: float | np.ndarray) -> Excess:
        e = np.where(self.scale == np.abs(self.reference.mean), error, 0.0)
        dd, dm, mm = self.moments.seconds
        ddd, ddm, dmm, mmm = self.moments.thirds
        variance = np.maximum(dd - 2 * e * dm + e**2 * mm, 0.0)  # a square that rounding may take below zero
        return Excess(self.test.mean - self.reference.mean - error * self.scale, variance + self.lent,
                      ddd - 3 * e * ddm + 3 * e**2 * dmm - e**3 * mmm, np.full_like(variance, self.test.dof))


def independent(test: ImageMoments, reference: ImageMoments) -> Iterator[IndependentContrast]:
    """Contrasts of the image, the larger and the smaller tiles of estimates with random numbers of their own."""
    for ours, theirs in zip(test, reference, strict=True):
        yield IndependentContrast.of(ours, theirs)


def scale_of(reference: TileMoments) -> np.ndarray:
    """What errors of tiles are relative to, (rows, columns, C): see `verdicts.TileVerdict.error`."""
    pixels = reference.pixels
    whole = error_scale((reference.mean * pixels).sum((0, 1)) / pixels.sum())
    single = reference.mean.shape[:2] == (1, 1)
    return whole[None, None] if single else np.maximum(np.abs(reference.mean), DARK_TILE * whole)


def borrowed(moments: TileMoments, scale: np.ndarray) -> np.ndarray:
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
