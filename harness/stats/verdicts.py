"""Is a render biased anywhere? Equivalence of the whole image and of its tiles, under heavy and unequal tails.

That means of renders be tested as hypotheses: Subr & Arvo 2007, "Statistical Hypothesis Testing for Assessing Monte
Carlo Estimators"; in pixels and regions, with the variances of both renderers: Jung, Hanika & Dachsbacher 2020,
"Detecting Bias in Monte Carlo Renderers using Welch's t-test", JCGT 9(2). Here the question is equivalence.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from harness.errors import HarnessError
from harness.stats.bias import POWER, Outcome, check_tolerance, percent
from harness.stats.channels import CHANNELS, Channel
from harness.stats.contrasts import Contrast, IndependentContrast, independent
from harness.stats.deviates import (
    all_exceed,
    critical_deviate,
    half_width,
    largest_deviate,
    one_sided,
    skew_deviate,
    skew_student,
)
from harness.stats.levels import check_level, family_level
from harness.stats.tiles import COARSER, ImageMoments, TileSamples

# How many tests a `BiasVerdict` consists of: the image, larger tiles, smaller tiles.
TESTS = 3
# Twice the probability with which a render passes that is off by a tolerance; intervals have the rest as confidence.
PASS_LEVEL = 0.05
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

    @property
    def sizes(self) -> tuple[float, float, float]:
        """Of the image, a larger and a smaller tile."""
        return self.mean, self.coarse, self.fine


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
                 fail_level: float = 0.01, pass_level: float = PASS_LEVEL) -> BiasVerdict:
    """Is the test equivalent to the reference as a whole and everywhere?

    The tiles of both are the smaller ones (see `tiles.tile_size`), with four channels. `fail_level`: the probability
    with which a good render fails at the most; the three tests share it (see `levels.family_level`). `pass_level`:
    twice the probability with which a render passes that is off by a tolerance; all three tests must pass, each at the
    full level (intersection-union test, Berger 1982). HarnessError for levels outside (0, 1), negative tolerances, and
    estimates with other tiles or sizes.
    """
    _check_alike(test, reference)
    contrasts = independent(ImageMoments.of(test), ImageMoments.of(reference))
    return judged(contrasts, test.tile, tolerance or Tolerance(), fail_level=fail_level, pass_level=pass_level)


def judged(contrasts: Iterable[Contrast], tile: int, tolerance: Tolerance, *, fail_level: float,
           pass_level: float) -> BiasVerdict:
    """The verdict on contrasts of the image, of the larger and of the smaller tiles, of `tile` pixels a side, as
    `bias_verdict` has it."""
    check_level(fail_level)
    each = family_level(fail_level, TESTS)
    whole, coarse, fine = (
        contrast_verdict(contrast, side, allowed, fail_level=each, pass_level=pass_level)
        for contrast, side, allowed in zip(contrasts, (tile, COARSER * tile, tile), tolerance.sizes, strict=True))
    gravest = min((whole, coarse, fine), key=lambda verdict: GRAVITY.index(verdict.outcome))
    return BiasVerdict(gravest.outcome, gravest.reason, whole, coarse, fine)


def tile_verdict(test: TileSamples, reference: TileSamples, tolerance: float, *, fail_level: float = 0.01,
                 pass_level: float = PASS_LEVEL) -> TileVerdict:
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
    _check_alike(test, reference)
    return contrast_verdict(IndependentContrast.of(test.moments(), reference.moments()), test.tile, tolerance,
                            fail_level=fail_level, pass_level=pass_level)


def contrast_verdict(contrast: Contrast, tile: int, tolerance: float, *, fail_level: float,
                     pass_level: float) -> TileVerdict:
    """The verdict of `tile_verdict` on a contrast of tiles of `tile` pixels a side.

    Where a single sample may count for much that has not come yet, `pass` and the intervals allow for it
    (`PairedContrast.interval`), and `fail` does not: what nobody has seen accuses nobody.
    """
    check_tolerance(tolerance)
    check_level(fail_level)
    check_level(pass_level)
    outcome, p = _decided(contrast, tolerance, fail_level, pass_level)
    difference, variance, _, dof = contrast.excess(0.0)
    error, sigma = difference / contrast.scale, np.sqrt(variance) / contrast.scale
    cell = family_level(fail_level, error.size)
    detectable = half_width(sigma, dof, cell) + half_width(sigma, dof, 2 * (1 - POWER))
    unseen = contrast.unseen(pass_level)
    low, high = contrast.interval(pass_level)
    z = skew_deviate(*contrast.excess(0.0))
    above, below = (skew_deviate(*contrast.excess(bound)) for bound in (tolerance, -tolerance))
    sure = critical_deviate(pass_level / 2)
    within = (-tolerance <= low) & (high <= tolerance) if unseen.any() else (-above >= sure) & (below >= sure)
    maps = _Maps(error, low, high, np.nan_to_num(np.maximum(above, -below), nan=-np.inf), within, unseen)
    reason = _reason(outcome, tile, contrast, maps, p, tolerance)
    row, column = np.unravel_index(int(np.argmax(np.abs(np.nan_to_num(z)))), z.shape)[:2]
    return TileVerdict(outcome, reason, tolerance, fail_level, pass_level, tile, error, maps.low, maps.high, z, p,
                       critical_deviate(cell / 2), (int(row), int(column)),
                       np.where(np.isnan(detectable), np.inf, detectable))


def bias_p_values(test: ImageMoments, reference: ImageMoments,
                  tolerance: Tolerance) -> tuple[float, float, float]:
    """The p of the three tests of `bias_verdict`, in its order, without the rest of it."""
    return contrast_p_values(independent(test, reference), tolerance)


def contrast_p_values(contrasts: Iterable[Contrast], tolerance: Tolerance) -> tuple[float, float, float]:
    """The p of the three tests of `judged`, in its order, without the rest of it."""
    whole, coarse, fine = (_p_value(contrast, allowed)
                           for contrast, allowed in zip(contrasts, tolerance.sizes, strict=True))
    return whole, coarse, fine


def bias_outcome(test: ImageMoments, reference: ImageMoments, tolerance: Tolerance, *, fail_level: float,
                 pass_level: float) -> Outcome:
    """The outcome of `bias_verdict`, decided by the same code, without intervals, maps and words: in a tenth of the
    time, for those who simulate many."""
    return contrast_outcome(independent(test, reference), tolerance, fail_level=fail_level, pass_level=pass_level)


def contrast_outcome(contrasts: Iterable[Contrast], tolerance: Tolerance, *, fail_level: float,
                     pass_level: float) -> Outcome:
    """The outcome of `judged`, alone."""
    each = family_level(fail_level, TESTS)
    outcomes = [_decided(contrast, allowed, each, pass_level)[0]
                for contrast, allowed in zip(contrasts, tolerance.sizes, strict=True)]
    return min(outcomes, key=GRAVITY.index)


class _Maps(NamedTuple):
    """What `_reason` goes by, arrays (rows, columns, 4)."""

    error: np.ndarray
    low: np.ndarray
    high: np.ndarray
    beyond: np.ndarray  # deviate of the excess over the tolerance
    equivalent: np.ndarray
    unseen: np.ndarray  # the allowance for samples that have not come yet


def _family_p(deviate: float, cells: int) -> float:
    """Two-sided p-value of the largest of so many deviates (Šidák)."""
    return float(-np.expm1(cells * np.log1p(-min(2 * one_sided(deviate), 1 - 1e-16))))


def _decided(contrast: Contrast, tolerance: float, fail_level: float, pass_level: float) -> tuple[Outcome, float]:
    """The outcome of `contrast_verdict`, and its p."""
    students, dofs = _beyond(contrast, tolerance)
    p = _largest_p(students, dofs)
    if not np.isfinite(contrast.test.mean).all():
        return "fail", p
    if not all(np.isfinite(values).all() for values in (contrast.reference.mean, contrast.test.variance,
                                                        contrast.reference.variance)):
        return "inconclusive", p
    if p < fail_level:
        return "fail", p
    if contrast.single.any():
        low, high = contrast.interval(pass_level)
        equivalent = bool((-tolerance <= low).all() and (high <= tolerance).all())
    else:
        equivalent = all_exceed(-students, dofs, critical_deviate(pass_level / 2))
    return ("pass" if equivalent else "inconclusive"), p


def _p_value(contrast: Contrast, tolerance: float) -> float:
    """The p of `contrast_verdict`."""
    return _largest_p(*_beyond(contrast, tolerance))


def _largest_p(students: np.ndarray, dofs: np.ndarray) -> float:
    """Two-sided, of the value of all that lies farthest beyond its bound; of what `_beyond` returns."""
    return _family_p(largest_deviate(students, dofs), students[0].size)


def _beyond(contrast: Contrast, bound: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far errors lie above +bound and below -bound, studentized, and degrees of freedom; (2, rows, columns, C)."""
    above, below = contrast.excess(bound), contrast.excess(-bound)
    return (np.stack([skew_student(*above[:3]), -skew_student(*below[:3])]), np.stack([above.dof, below.dof]))


def _reason(outcome: Outcome, tile: int, contrast: Contrast, maps: _Maps, p: float, tolerance: float) -> str:
    for name, side in (("test image", contrast.test), ("reference", contrast.reference)):
        broken = np.argwhere(~np.isfinite(side.mean))
        if broken.size:
            message = f"the {name} holds pixels that are not finite, in {_place(broken[0], tile, maps)}"
            return message if side is contrast.test else f"{message}; render it again"
    for name, side in (("test image", contrast.test), ("reference", contrast.reference)):
        if not np.isfinite(side.variance).all():
            return f"the variance of the {name} is unknown: it takes two batches or more"

    def told(index: tuple[np.intp, ...]) -> str:
        return (f"{_place(index, tile, maps)}: {CHANNELS[index[-1]]} {percent(maps.error[index], signed=True)} "
                f"[{percent(maps.low[index], signed=True)}, {percent(maps.high[index], signed=True)}]")

    band = f"±{percent(tolerance)}"
    if outcome == "fail":
        clearest = np.unravel_index(int(np.argmax(maps.beyond)), maps.beyond.shape)
        return f"{told(clearest)} lies outside {band}, by chance with probability {p:.1g}"
    reach = np.maximum(np.abs(maps.low), np.abs(maps.high))
    farthest = np.unravel_index(int(np.argmax(reach)), reach.shape)
    widest = told(farthest)
    if maps.unseen[farthest] > 0:
        widest += f", which allows {percent(maps.unseen[farthest])} for samples that have not come yet"
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
