"""Is a render biased? Equivalence verdicts on image means and on tiles, with a tolerance and family-wise control."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import special

from harness.errors import HarnessError

Outcome = Literal["pass", "fail", "inconclusive"]

# The order of the four means of an image wherever this package holds them in one array.
CHANNELS = ("red", "green", "blue", "luminance")

# Probability with which a bias of the size `smallest_detectable` is found.
POWER = 0.95
# A channel whose mean is below this part of the luminance mean is black: float32 rounding alone reaches 1e-7 of it.
BLACK = 1e-6
# A tile darker than this part of the image's mean is measured against that part, not against its own near-zero mean.
DARK_TILE = 0.01
# The |z| beyond which a normal tail probability is no longer representable; z-maps saturate there.
Z_LIMIT = 37.0


@dataclass(frozen=True, eq=False)
class MeanErrorVerdict:
    """Signed error of the image means of red, green, blue and luminance (arrays of shape (4,), in that order).

    `error`: (test - reference) / scale, where scale is the channel's reference mean; for a black channel the
    reference's luminance mean; for a black reference 1, so that errors are absolute, in radiance.
    `low`, `high`: each channel's own confidence interval at `confidence`. `smallest_detectable`: the smallest bias
    that these samples tell apart from none with probability 0.95; infinite where the variance is unknown.
    `reason`: one line that says why the outcome is what it is.
    """

    outcome: Outcome
    reason: str
    tolerance: float
    confidence: float
    error: np.ndarray
    low: np.ndarray
    high: np.ndarray
    dof: np.ndarray
    smallest_detectable: np.ndarray


@dataclass(frozen=True, eq=False)
class TileVerdict:
    """Local errors, one per tile: arrays of shape (rows, columns), with a last axis of channels if the images had one.

    `error`: relative to the tile's reference mean, or to 1 % of the image's where the tile is darker. `z`: error over
    its standard error, as a normal deviate, positive where the test is too bright. `critical`: the |z| that chance
    exceeds anywhere in the map with probability 1 - `confidence`. `worst`: (row, column) of the tile with the largest
    |z|; its first pixel is `worst` times `tile`. `smallest_detectable`: as in `MeanErrorVerdict`, for each tile.
    """

    outcome: Outcome
    reason: str
    tolerance: float
    confidence: float
    tile: int
    error: np.ndarray
    z: np.ndarray
    critical: float
    worst: tuple[int, int]
    smallest_detectable: np.ndarray


def error_scale(reference_mean: np.ndarray) -> np.ndarray:
    """What the errors of the four image means are divided by, (4,) -> (4,); see `MeanErrorVerdict.error`."""
    mean = np.abs(np.asarray(reference_mean, dtype=np.float64))
    luminance = mean[3] if mean[3] > 0 else 1.0
    return np.where(mean > BLACK * luminance, mean, luminance)


def mean_error_verdict(test_mean: np.ndarray, test_variance: np.ndarray, test_dof: float, reference_mean: np.ndarray,
                       reference_variance: np.ndarray, reference_dof: float, *, tolerance: float = 0.002,
                       confidence: float = 0.95) -> MeanErrorVerdict:
    """Equivalence test of image means against a reference rendered independently.

    Means and the variances of those means have shape (4,); `*_dof` are the degrees of freedom of the variances, one
    less than the number of batches, infinite for an exact value. The error is a ratio of means, so its variance comes
    from the delta method (first order), its degrees of freedom from Welch (1947) and Satterthwaite (1946).

    - pass: all four intervals lie within ±tolerance. Each is at the full `confidence`: claiming that *all* channels
      are equivalent needs no correction for their number (intersection-union test, Berger 1982), and a render whose
      true bias is as large as the tolerance passes with probability at most (1 - confidence) / 2.
    - fail: one of the four lies entirely outside ±tolerance at confidence 1 - (1 - confidence) / 4 (Bonferroni, which
      holds however the channels are correlated), so that a good render fails with probability below 1 - confidence;
      or the test's mean is not finite.
    - inconclusive: neither, or a variance is unknown (NaN, from fewer than two batches).

    HarnessError for a negative tolerance or a confidence outside (0, 1).
    """
    _check_levels(tolerance, confidence)
    test_mean, test_variance, reference_mean, reference_variance = (
        np.asarray(a, dtype=np.float64) for a in (test_mean, test_variance, reference_mean, reference_variance))
    scale = error_scale(reference_mean)
    error = (test_mean - reference_mean) / scale
    from_test = test_variance / scale**2
    # A black channel is measured in units of luminance, which is as good as exact beside the channel's own noise.
    slope = np.where(scale == np.abs(reference_mean), test_mean / scale, 1.0)
    from_reference = slope**2 * reference_variance / scale**2
    sigma = np.sqrt(from_test + from_reference)
    dof = _satterthwaite(from_test + from_reference, from_test**2 / test_dof + from_reference**2 / reference_dof)
    alpha = 1 - confidence
    half = _half_width(sigma, dof, alpha)
    guarded = _half_width(sigma, dof, alpha / len(CHANNELS))
    detectable = guarded + _half_width(sigma, dof, 2 * (1 - POWER))
    outcome, reason = _judge_means(test_mean, test_variance, reference_mean, reference_variance, error, half, guarded,
                                   tolerance, confidence, noisier_reference=from_reference > from_test)
    return MeanErrorVerdict(outcome, reason, tolerance, confidence, error, error - half, error + half, dof,
                            np.where(np.isnan(detectable), np.inf, detectable))


def tile_verdict(test_mean: np.ndarray, test_variance: np.ndarray, test_dof: float, reference_mean: np.ndarray,
                 reference_variance: np.ndarray, reference_dof: float, *, tile: int = 16, tolerance: float = 0.05,
                 confidence: float = 0.95) -> TileVerdict:
    """Equivalence test of each tile of `tile` x `tile` pixels, for defects too local to move the image's mean.

    Images and variances of their pixels have shape (H, W) or (H, W, C); tiles at the right and bottom edges may be
    smaller. Pixels are taken to be independent, which a box filter and a random stream for each pixel guarantee.
    The degrees of freedom of a tile pool those of its pixels (Satterthwaite 1946).

    - fail: some tile's error exceeds the tolerance significantly, at a level corrected for the number of tiles and
      channels (Šidák 1967), so that a good render fails with probability below 1 - confidence; or a pixel of the test
      is not finite.
    - pass: every tile's interval at `confidence` lies within ±tolerance.
    - inconclusive: neither, or a variance is unknown.

    Valid for test and reference with *equal tails* only: where one side draws rare bright samples and the other does
    not, its skewness makes the false-alarm rate of the largest of many tiles several times the nominal one.
    HarnessError for a tile below 1, a negative tolerance or a confidence outside (0, 1).
    """
    _check_levels(tolerance, confidence)
    if tile < 1:
        raise HarnessError(f"tile size must be at least 1 pixel, found {tile}")
    test_mean, test_variance, reference_mean, reference_variance = (
        np.asarray(a, dtype=np.float64) for a in (test_mean, test_variance, reference_mean, reference_variance))
    pixels = tile_sums(np.ones_like(reference_mean), tile)
    test, reference = tile_sums(test_mean, tile) / pixels, tile_sums(reference_mean, tile) / pixels
    from_test, from_reference = (tile_sums(v, tile) / pixels**2 for v in (test_variance, reference_variance))
    variance = from_test + from_reference
    squares = test_variance**2 / test_dof + reference_variance**2 / reference_dof
    dof = _satterthwaite(variance, tile_sums(squares, tile) / pixels**4)
    floor = DARK_TILE * np.abs(reference_mean.mean((0, 1)))
    scale = np.maximum(np.abs(reference), np.where(floor > 0, floor, 1.0))
    error = (test - reference) / scale
    sigma = np.sqrt(variance) / scale
    z = np.sign(error) * _normal_deviate(np.abs(error), sigma, dof)
    # Testing T > (1 + tolerance) R, in which the reference's noise counts by as much more.
    wide = np.sqrt(from_test + (1 + tolerance)**2 * from_reference) / scale
    excess = _normal_deviate(np.abs(error) - tolerance, wide, dof)
    alpha = 1 - confidence
    per_tile = -np.expm1(np.log1p(-alpha) / error.size)
    critical = float(special.ndtri(1 - per_tile / 2))
    within = np.abs(error) + _half_width(wide, dof, alpha) <= tolerance
    detectable = _half_width(sigma, dof, per_tile) + _half_width(sigma, dof, 2 * (1 - POWER))
    peak = np.unravel_index(int(np.argmax(np.abs(np.nan_to_num(z, nan=Z_LIMIT)))), z.shape)
    outcome, reason = _judge_tiles(test_mean, error[peak], within, excess, critical, tile, peak, tolerance)
    return TileVerdict(outcome, reason, tolerance, confidence, tile, error, z, critical,
                       (int(peak[0]), int(peak[1])), np.where(np.isnan(detectable), np.inf, detectable))


def check_confidence(confidence: float) -> None:
    """HarnessError unless 0 < confidence < 1."""
    if not 0 < confidence < 1:
        raise HarnessError(f"confidence must lie between 0 and 1 (0.95 is 95 %), found {confidence}")


def tile_sums(image: np.ndarray, tile: int) -> np.ndarray:
    """Sums over tiles of `tile` x `tile` pixels, (H, W, ...) -> (ceil(H/tile), ceil(W/tile), ...)."""
    rows, columns = (np.arange(0, size, tile) for size in image.shape[:2])
    return np.add.reduceat(np.add.reduceat(image, rows, axis=0), columns, axis=1)


def _judge_means(test_mean: np.ndarray, test_variance: np.ndarray, reference_mean: np.ndarray,
                 reference_variance: np.ndarray, error: np.ndarray, half: np.ndarray, guarded: np.ndarray,
                 tolerance: float, confidence: float, *, noisier_reference: np.ndarray) -> tuple[Outcome, str]:
    band = f"±{_percent(tolerance)}"
    if not np.isfinite(test_mean).all():
        return "fail", "the test image holds pixels that are not finite"
    if not np.isfinite(reference_mean).all():
        return "inconclusive", "the reference holds pixels that are not finite; render it again"
    for name, variance in (("test image", test_variance), ("reference", reference_variance)):
        if not np.isfinite(variance).all():
            return "inconclusive", f"the variance of the {name} is unknown: it takes two batches or more"

    def told(channel: int, width: np.ndarray) -> str:
        return f"{CHANNELS[channel]} {_signed(error[channel])} ± {_percent(width[channel])}"

    beyond = np.abs(error) - guarded
    if (beyond > tolerance).any():
        return "fail", f"{told(int(np.argmax(beyond)), guarded)} lies outside {band}"
    reach = np.abs(error) + half
    worst = int(np.argmax(reach))
    if reach[worst] <= tolerance:
        return "pass", f"all channels lie within {band} at {_percent(confidence)} confidence; {told(worst, half)}"
    message = f"{told(worst, half)} reaches beyond {band}"
    room = tolerance - abs(error[worst])
    if room > 0:
        noisier = "reference" if noisier_reference[worst] else "test image"
        message += f"; about {max((half[worst] / room)**2, 1.1):.2g} times the samples would decide, " \
                   f"first of all in the {noisier}"
    return "inconclusive", message


def _judge_tiles(test_mean: np.ndarray, peak_error: float, within: np.ndarray, excess: np.ndarray, critical: float,
                 tile: int, peak: tuple[np.intp, ...], tolerance: float) -> tuple[Outcome, str]:
    broken = ~np.isfinite(test_mean)
    if broken.any():
        row, column = (int(i) for i in np.argwhere(broken)[0][:2])
        return "fail", (f"{int(broken.sum())} values of the test image are not finite, "
                        f"the first at pixel x={column}, y={row}")
    if np.isnan(excess).any():
        return "inconclusive", "the variance of a pixel is unknown: it takes two batches or more of both images"
    place = f"the tile at x={int(peak[1]) * tile}, y={int(peak[0]) * tile}"
    bad = int((excess > critical).sum())
    if bad:
        row, column = (int(i) for i in np.unravel_index(int(np.argmax(excess)), excess.shape)[:2])
        return "fail", (f"{bad} of {excess.size} tiles differ by more than {_percent(tolerance)}; "
                        f"most surely the one at x={column * tile}, y={row * tile}")
    if within.all():
        return "pass", (f"all {within.size} tiles lie within ±{_percent(tolerance)}; "
                        f"the most conspicuous is {place}, {_signed(peak_error)}")
    return "inconclusive", (f"{int((~within).sum())} of {within.size} tiles may differ by more than "
                            f"{_percent(tolerance)}; draw more samples")


def _satterthwaite(variance: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """Degrees of freedom of a sum of variances, given Σ variance²/dof; infinite where nothing is uncertain."""
    with np.errstate(invalid="ignore"):
        return np.where(squares == 0, np.inf, variance**2 / np.where(squares == 0, 1.0, squares))


def _half_width(sigma: np.ndarray, dof: np.ndarray, alpha: float) -> np.ndarray:
    """Half the two-sided Student interval at level 1 - alpha."""
    return sigma * special.stdtrit(dof, 1 - alpha / 2)


def _normal_deviate(value: np.ndarray, sigma: np.ndarray, dof: np.ndarray) -> np.ndarray:
    """value/sigma, Student distributed, as the normal deviate with the same tail probability, within ±Z_LIMIT."""
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(sigma == 0, np.where(value == 0, 0.0, np.copysign(np.inf, value)), value / sigma)
    # The lower tail keeps its digits where the upper one would round to one.
    z = special.ndtri(special.stdtr(dof, -np.abs(t)))
    return np.where(np.isnan(t), np.nan, np.copysign(np.minimum(-z, Z_LIMIT), t))


def _check_levels(tolerance: float, confidence: float) -> None:
    if not tolerance >= 0:
        raise HarnessError(f"tolerance must be zero or more (0.002 is 0.2 %), found {tolerance}")
    check_confidence(confidence)


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.3g} %"


def _signed(fraction: float) -> str:
    return f"{100 * fraction:+.3g} %"
