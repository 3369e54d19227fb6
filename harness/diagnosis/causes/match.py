"""Whether a picture is another but for noise, and which of many it most likely is: arrays only.

χ² alone does not rank candidates: the noisier one is, the better it fits everything. The likelihood has the logarithm
of the noise as well, which is what a noisy candidate pays. Noise here is that of both pictures, and its tails are
heavy: the likelihood is Student's t (Lange, Little & Taylor 1989, "Robust Statistical Modeling Using the t
Distribution").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter
from scipy.special import betainc, chdtrc

from harness.samples.estimate import Estimate, with_luminance
from harness.stats.deviates import skew_student

# Degrees of freedom of the likelihood: between a normal's and those of a variance from a handful of batches.
TAIL = 5.0
# A pixel's own variance weighs as much as its batches' degrees of freedom, the mean of its neighbours' as much as this.
NEIGHBOURS_WEIGH = 8.0
# Relative to a pixel's value: rounding, and half floats that images were kept in, are no evidence.
ROUNDING = 5e-4
# Sides of the tiles in which two pictures are compared, in pixels; the whole image besides.
TILES = (4, 8, 16)
# One pixel cannot say more than this many standard errors squared: fireflies are no evidence for a cause.
CAP = 16.0
# Two pictures are different below this probability, all tiles, sizes and channels together: so low that images whose
# noise has heavy tails are not called different. At 1e-5, five of 52 right images of `cornell` were, drawn uniformly,
# which meets the light in one direction of fifty.
LEVEL = 1e-8
# A mean of squared standard errors over pixels this far above 1 is a difference, once what few bright samples make of
# it is taken out (`skew_student`): without that, right images of `cornell`, drawn uniformly, had 1.09 to 1.33 and were
# called different once in 60; with it they have 0.87 to 1.12.
PIXEL_EXCESS = 0.3
LARGEST = 1.0 + PIXEL_EXCESS
# Where so many pixels have no noise though six of their eight neighbours have, as no edge makes them, most of it has
# not come yet, and neither a pixel says anything by itself nor the smallest tiles: of 60 right images of `cornell`,
# drawn uniformly with half of the paths ended at every vertex (0.05 here; of other strangers 0.01 at most), pixels told
# all from the right one, and tiles of 4 seven.
UNRESOLVED, SURROUNDED = 0.02, 5.5 / 9
# Where rounding makes a picture: by what part of its difference from the right one another's may be off, everywhere at
# once. Rays that start on the surface take 22.7 % of the light of `spheres` in one host's shader, 23.0 % in another's.
MUCH_LIKE = 0.05


@dataclass(frozen=True, eq=False)
class Seen:
    """An estimate as it is compared: `mean`, `variance` (H, W, 3), the latter steadied by neighbouring pixels.

    `inflation`: how much larger the variance of the image's mean is than independent pixels would have it, at least 1:
    pixels that share random numbers are correlated. `dof`: of the variances, infinite where exact. `third`: (H, W, 3),
    the third central moment of the mean, None where it counts as zero. `unresolved`: the part of the pixels that have
    no variance among others that have.
    """

    mean: np.ndarray
    variance: np.ndarray
    inflation: float
    dof: float
    third: np.ndarray | None = None
    unresolved: float = 0.0

    @classmethod
    def of(cls, estimate: Estimate) -> Seen:
        """ValueError where the estimate knows no variance."""
        if np.isnan(estimate.variance).any():
            raise ValueError("an image without a variance cannot be told from another; draw at least two batches")
        own = estimate.variance
        if estimate.batches == 0:
            return cls(estimate.mean, own, 1.0, np.inf)
        dof = estimate.batches - 1.0
        around = np.maximum(uniform_filter(own, size=(3, 3, 1), mode="nearest"), 0.0)  # its running sums round
        steadied = (dof * own + NEIGHBOURS_WEIGH * around) / (dof + NEIGHBOURS_WEIGH)
        pixels = own.shape[0] * own.shape[1]
        independent = own.sum((0, 1)) / pixels**2
        known = independent > 0
        ratio = np.divide(estimate.image_variance[:3], independent, out=np.ones(3), where=known)
        beside = uniform_filter((own > 0).astype(np.float32), size=(3, 3, 1), mode="nearest")
        unresolved = float(((own == 0) & (beside > SURROUNDED)).mean())
        return cls(estimate.mean, steadied, max(1.0, float(ratio.mean())), dof, estimate.third, unresolved)


@dataclass(frozen=True)
class Fit:
    """How well one picture fits another.

    `chi2`: the mean over pixels and channels of the squared difference over its variance, no more than `CAP` each:
    about 1 where they are the same. `loglik`: the log-likelihood up to what all candidates have in common. `p`: the
    probability that the same picture would differ by so much, 0 where pixels alone exclude it. `same`: it is not
    excluded.
    """

    chi2: float
    loglik: float
    p: float
    same: bool


def fit(found: Seen, other: Seen, mask: np.ndarray | None = None) -> Fit:
    """How well `other` fits what was `found`; `mask` (H, W): the pixels that count, all unless given."""
    difference, variance, kept = _compared(found, other, mask)
    z2 = np.minimum(difference**2 / variance, CAP)
    chi2 = float(z2[kept].mean())
    resolved = max(found.unresolved, other.unresolved) < UNRESOLVED
    skewed = np.minimum(skew_student(difference, variance, _third(found, other, kept)) ** 2, CAP)
    p = 0.0 if resolved and float(skewed[kept].mean()) >= LARGEST else _probability(
        difference, np.where(kept[..., None], variance, 0.0), found, other, TILES if resolved else TILES[1:])
    return Fit(chi2, loglik(found, other, mask), p, p > LEVEL)


def much_like(found: Seen, other: Seen, right: Seen, mask: np.ndarray | None = None) -> Fit:
    """The same where rounding makes the picture: it may be off by `MUCH_LIKE` of what it does to the `right` one."""
    room = (MUCH_LIKE * (other.mean - right.mean)) ** 2
    found_fit = fit(found, replace(other, variance=other.variance + room), mask)
    return replace(found_fit, same=found_fit.chi2 < LARGEST)  # tiles are off together, which no noise explains


def gain(found: Seen, other: Seen, right: Seen, mask: np.ndarray | None = None) -> float:
    """By how much more likely `found` is of `other` than of the `right` picture, if both were known as badly: the
    difference of their log-likelihoods with the noise of all three in each.

    A defect that must be drawn in a noisy way would pay for its noise in a likelihood of its own (`loglik`), and lose
    to the right picture, or to a wrong one that is drawn with less. So each picture is compared with the right one at
    the noise of the two, and what noise the one has, and the other has not, is added to the other's difference.
    """
    kept = np.ones(found.mean.shape[:2], bool) if mask is None else mask
    level = np.maximum(np.abs(found.mean), np.maximum(np.abs(other.mean), np.abs(right.mean)))
    variance = found.variance + other.variance + right.variance + (ROUNDING * level) ** 2 + 1e-18
    from_right = (found.mean - right.mean) ** 2 + other.variance
    from_other = (found.mean - other.mean) ** 2 + right.variance
    terms = np.log1p(from_right / (TAIL * variance)) - np.log1p(from_other / (TAIL * variance))
    return (TAIL + 1) * float(terms[kept].sum()) / 6.0


def loglik(found: Seen, other: Seen, mask: np.ndarray | None = None) -> float:
    """The log-likelihood of what was `found` where `other` is the true picture, up to what all pictures share.

    Channels see the same paths: three of them are little more evidence than one, and count a third each.
    """
    difference, variance, kept = _compared(found, other, mask)
    terms = (TAIL + 1) * np.log1p(difference**2 / (TAIL * variance)) + np.log(variance)
    return -float(terms[kept].sum()) / 6.0


def _compared(found: Seen, other: Seen, mask: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The difference, its variance, (H, W, 3), and which pixels count, (H, W)."""
    kept = np.ones(found.mean.shape[:2], bool) if mask is None else mask
    difference = np.where(kept[..., None], found.mean - other.mean, 0.0)
    level = np.maximum(np.abs(found.mean), np.abs(other.mean))
    return difference, found.variance + other.variance + (ROUNDING * level) ** 2 + 1e-18, kept


def apart(one: Seen, other: Seen, noise: Seen) -> float:
    """By how much the log-likelihood of two pictures differs at the noise of a third, if one of them is right.

    0 where they are the same but for their own noise.
    """
    own = one.variance + other.variance
    variance = noise.variance + 0.5 * own + (ROUNDING * np.maximum(np.abs(one.mean), np.abs(other.mean))) ** 2 + 1e-18
    excess = ((one.mean - other.mean) ** 2 - own) / variance
    return max(0.0, 0.5 * float(np.minimum(excess, CAP).sum()) / 3.0)


def smaller(estimate: Estimate, factor: int) -> Estimate:
    """The estimate with `factor` x `factor` pixels merged into one: what a box filter so much wider would see.

    ValueError where the factor does not divide both sides.
    """
    if factor == 1:
        return estimate
    height, width = estimate.mean.shape[:2]
    if height % factor or width % factor:
        raise ValueError(f"{width}x{height} pixels cannot be merged {factor} by {factor}")
    mean = _blocks(estimate.mean, factor).mean((1, 3))
    variance = _blocks(estimate.variance, factor).sum((1, 3)) / factor**4
    luminance = _blocks(estimate.luminance_variance[..., None], factor).sum((1, 3))[..., 0] / factor**4
    third = None if estimate.third is None else _blocks(estimate.third, factor).sum((1, 3)) / factor**6
    return Estimate(mean, variance, luminance, with_luminance(mean).mean((0, 1)), estimate.image_variance,
                    estimate.samples * factor**2, estimate.batches, estimate.rejected, estimate.cost, third,
                    estimate.image_third)


def factor_to(size: tuple[int, int], pixels: int) -> int:
    """The least whole number that divides both sides of (width, height) and leaves at most so many pixels; 1 where
    there is none."""
    width, height = size
    for factor in range(1, min(size) // 8 + 1):
        if width % factor == 0 and height % factor == 0 and width * height <= pixels * factor**2:
            return factor
    return 1


def _third(found: Seen, other: Seen, kept: np.ndarray) -> np.ndarray:
    """The third central moment of the difference of two pictures, (H, W, 3); 0 of pixels that do not count."""
    parts = [part for part in (found.third, None if other.third is None else -other.third) if part is not None]
    return np.where(kept[..., None], sum(parts, start=np.zeros_like(found.mean)), 0.0)


def _probability(difference: np.ndarray, variance: np.ndarray, found: Seen, other: Seen,
                 tiles: Sequence[int]) -> float:
    """That the same picture would differ by so much: the least over tiles and channels, times how many were asked.

    A tile's variance is as uncertain as Satterthwaite's degrees of freedom say (1946, "An Approximate Distribution of
    Estimates of Variance Components"): little where its pixels are alike, much where a few have nearly all of it. Too
    few bright samples make a mean too low and too sure, which Hall's transformation takes out (see `skew_student`).
    """
    height, width = variance.shape[:2]
    inflation = max(found.inflation, other.inflation)
    asked: list[float] = []
    third = _third(found, other, variance[..., 0] > 0)
    for side in (*(side for side in tiles if side < min(height, width)), max(height, width)):
        total = np.stack([_sums(difference[..., c], side) for c in range(3)], -1)
        spread = np.stack([_sums(variance[..., c], side) for c in range(3)], -1) * inflation
        skew = np.stack([_sums(third[..., c], side) for c in range(3)], -1) * inflation**1.5
        z2 = np.where(spread > 0, skew_student(total, spread, skew), 0.0) ** 2
        dof: float | np.ndarray = min(found.dof, other.dof)
        if side < max(height, width) and np.isfinite(dof):
            squares = np.stack([_sums(variance[..., c] ** 2, side) for c in range(3)], -1) * inflation**2
            dof = dof * np.divide(spread**2, squares, out=np.ones_like(spread), where=squares > 0)
        # The largest, and not the sum: where pixels share random numbers, tiles err together.
        asked += [z2[..., 0].size * float(p) for p in _two_sided(z2, dof).min((0, 1))]
    return min(1.0, len(asked) * min(asked))


def _two_sided(t2: np.ndarray, dof: float | np.ndarray) -> np.ndarray:
    """The probability of a larger square of Student's t, or of a normal deviate where `dof` is infinite."""
    if np.isinf(dof).any():
        return np.asarray(chdtrc(1.0, t2))
    return np.asarray(betainc(0.5 * np.asarray(dof), 0.5, dof / (dof + t2)))


def _sums(image: np.ndarray, side: int) -> np.ndarray:
    rows = np.add.reduceat(image, np.arange(0, image.shape[0], side), axis=0)
    return np.add.reduceat(rows, np.arange(0, image.shape[1], side), axis=1)


def _blocks(image: np.ndarray, factor: int) -> np.ndarray:
    height, width = image.shape[:2]
    return image.reshape(height // factor, factor, width // factor, factor, *image.shape[2:])
