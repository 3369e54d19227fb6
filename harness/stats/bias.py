"""Is the mean of a render biased? An equivalence verdict from means and variances alone, as image files hold them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from harness.errors import HarnessError
from harness.stats.channels import CHANNELS, Channel
from harness.stats.deviates import half_width, satterthwaite, skew_interval
from harness.stats.levels import check_level
from harness.stats.needed import times

Outcome = Literal["pass", "fail", "inconclusive"]

# Probability with which a bias of the size `smallest_detectable` is found.
POWER = 0.95
# A channel whose mean is below this part of the luminance mean is black: float32 rounding alone reaches 1e-7 of it.
BLACK = 1e-6


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

    @property
    def luminance(self) -> tuple[float, float, float]:
        """Error, low and high of luminance."""
        error, low, high = (float(values[Channel.LUMINANCE]) for values in (self.error, self.low, self.high))
        return error, low, high


def error_scale(reference_mean: np.ndarray) -> np.ndarray:
    """What the errors of the four image means are divided by, (4,) -> (4,); see `MeanErrorVerdict.error`."""
    mean = np.abs(np.asarray(reference_mean, dtype=np.float64))
    luminance = mean[Channel.LUMINANCE] if mean[Channel.LUMINANCE] > 0 else 1.0
    return np.where(mean > BLACK * luminance, mean, luminance)


def mean_error_verdict(test_mean: np.ndarray, test_variance: np.ndarray, test_dof: float, reference_mean: np.ndarray,
                       reference_variance: np.ndarray, reference_dof: float, *, test_third: np.ndarray | None = None,
                       reference_third: np.ndarray | None = None, tolerance: float = 0.002,
                       confidence: float = 0.95, fail_level: float | None = None) -> MeanErrorVerdict:
    """Equivalence test of image means against a reference rendered independently.

    Means, and the variances and third central moments of those means, have shape (4,); of a third moment that is not
    known none is seen. `*_dof` are the degrees of freedom of the variances, one less than the number of batches (or
    those of `deviates.staged`), infinite for an exact value. The error is a ratio of means, so its moments come from
    the delta method (first order), its degrees of freedom from Welch (1947) and Satterthwaite (1946), its interval, as
    that of every tile, from `deviates.skew_interval`.

    8 batches know little of a heavy tail. Simulated, 40,000 runs: a nominal 5 % misses of 8 normal batches in 3.8 %, of
    a gamma law of shape 2 in 4.7 %, of log-normal ones of σ 0.8 in 7.4 % (Student: 12.9 %), and where one batch in four
    meets a bright sample in 13 %, for of such runs a tenth meets none.

    - pass: all four intervals lie within ±tolerance. Each is at the full `confidence`: claiming that *all* channels
      are equivalent needs no correction for their number (intersection-union test, Berger 1982), and a render whose
      true bias is as large as the tolerance passes with probability at most (1 - confidence) / 2.
    - fail: one of the four lies entirely outside ±tolerance at confidence 1 - `fail_level` / 4 (Bonferroni, which
      holds however the channels are correlated), so that a good render fails with probability below `fail_level`,
      1 - confidence where None; or the test's mean is not finite.
    - inconclusive: neither, or a variance is unknown (NaN, from fewer than two batches).

    HarnessError for a negative tolerance, a confidence or a level outside (0, 1).
    """
    check_tolerance(tolerance)
    check_confidence(confidence)
    if fail_level is not None:
        check_level(fail_level)
    test_mean, test_variance, reference_mean, reference_variance = (
        np.asarray(a, dtype=np.float64) for a in (test_mean, test_variance, reference_mean, reference_variance))
    scale = error_scale(reference_mean)
    error = (test_mean - reference_mean) / scale
    from_test = test_variance / scale**2
    # A black channel is measured in units of luminance, which is as good as exact beside the channel's own noise.
    slope = np.where(scale == np.abs(reference_mean), test_mean / scale, 1.0)
    from_reference = slope**2 * reference_variance / scale**2
    variance = from_test + from_reference
    third = (_known(test_third) - slope**3 * _known(reference_third)) / scale**3
    dof = satterthwaite(variance, from_test**2 / test_dof + from_reference**2 / reference_dof)
    alpha = 1 - confidence
    own = skew_interval(error, variance, third, dof, alpha)
    guarded = skew_interval(error, variance, third, dof, (alpha if fail_level is None else fail_level) / len(CHANNELS))
    detectable = (np.maximum(error - guarded[0], guarded[1] - error)
                  + half_width(np.sqrt(variance), dof, 2 * (1 - POWER)))
    outcome, reason = _judge_means(test_mean, test_variance, reference_mean, reference_variance, error, own, guarded,
                                   tolerance, confidence, noisier_reference=from_reference > from_test)
    return MeanErrorVerdict(outcome, reason, tolerance, confidence, error, *own, dof,
                            np.where(np.isnan(detectable), np.inf, detectable))


def check_confidence(confidence: float) -> None:
    """HarnessError unless 0 < confidence < 1."""
    if not 0 < confidence < 1:
        raise HarnessError(f"confidence must lie between 0 and 1 (0.95 is 95 %), found {confidence}")


def check_tolerance(tolerance: float) -> None:
    """HarnessError for a negative tolerance."""
    if not tolerance >= 0:
        raise HarnessError(f"tolerance must be zero or more (0.002 is 0.2 %), found {tolerance}")


def _known(third: np.ndarray | None) -> np.ndarray:
    return np.zeros(len(CHANNELS)) if third is None else np.asarray(third, dtype=np.float64)


def _judge_means(test_mean: np.ndarray, test_variance: np.ndarray, reference_mean: np.ndarray,
                 reference_variance: np.ndarray, error: np.ndarray, own: tuple[np.ndarray, np.ndarray],
                 guarded: tuple[np.ndarray, np.ndarray], tolerance: float, confidence: float, *,
                 noisier_reference: np.ndarray) -> tuple[Outcome, str]:
    band = f"±{percent(tolerance)}"
    if not np.isfinite(test_mean).all():
        return "fail", "the test image holds pixels that are not finite"
    if not np.isfinite(reference_mean).all():
        return "inconclusive", "the reference holds pixels that are not finite; render it again"
    for name, variance in (("test image", test_variance), ("reference", reference_variance)):
        if not np.isfinite(variance).all():
            return "inconclusive", f"the variance of the {name} is unknown: it takes two batches or more"

    def told(channel: int, interval: tuple[np.ndarray, np.ndarray]) -> str:
        low, high = (percent(bound[channel], signed=True) for bound in interval)
        return f"{CHANNELS[channel]} {percent(error[channel], signed=True)} [{low}, {high}]"

    beyond = np.maximum(guarded[0], -guarded[1])
    if (beyond > tolerance).any():
        return "fail", f"{told(int(np.argmax(beyond)), guarded)} lies outside {band}"
    low, high = own
    reach = np.maximum(-low, high)
    worst = int(np.argmax(reach))
    if reach[worst] <= tolerance:
        return "pass", f"all channels lie within {band} at {percent(confidence)} confidence; {told(worst, own)}"
    message = f"{told(worst, own)} reaches beyond {band}"
    room = tolerance - abs(error[worst])
    if room > 0:
        noisier = "reference" if noisier_reference[worst] else "test image"
        shrink = max((high[worst] - error[worst]) / (tolerance - error[worst]),
                     (error[worst] - low[worst]) / (tolerance + error[worst]))
        message += f"; {times(shrink**2)} the samples would decide, first of all in the {noisier}"
    return "inconclusive", message


def percent(fraction: float | None, *, signed: bool = False) -> str:
    """'0.31 %', or '+0.31 %'; '∞' for what has no bound, or is not finite."""
    if fraction is None or not np.isfinite(fraction):
        return "∞"
    return f"{100 * fraction:{'+' if signed else ''}.3g} %"
