"""How fast does an error fall with samples? Power-law fits, equal-error costs and bands, over independent replicas."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import special

from harness.errors import HarnessError
from harness.stats.bias import Outcome, check_confidence

# Of logarithms of errors, below which they are the same.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Slope:
    """The power law error = coefficient x spp^slope, with the slope's confidence interval over the replicas.

    `coefficient` is the law's error at one sample per pixel, in the error's unit. `points` counts the prefixes that
    the fit uses. With a single replica the interval is infinite; with fewer than two usable prefixes slope and
    coefficient are NaN.
    """

    slope: float
    low: float
    high: float
    confidence: float
    replicas: int
    coefficient: float
    points: int


def fit_slope(spp: np.ndarray, rmse: np.ndarray, confidence: float = 0.95) -> Slope:
    """Fit a power law to the replicas' mean squared error by least squares on log-log axes.

    `spp` (P,), `rmse` (R, P) or (P,). The *squares* are averaged over replicas before the logarithm, because it is
    they whose expectation falls as 1/N: the mean of the replicas' own logarithms lies below it, the more so the
    heavier the tail and the fewer the samples, and that flattens the slope. (Simulated, 8 replicas, pixels of which
    1 sample in 10^4 carries all the light: the average of the replicas' slopes is -0.32 and its 95 % interval holds
    -1/2 in 72 % of runs; this fit gives -0.503 and 98 %. Beyond that, at 1 in 10^5 and 1024 samples, no interval from
    8 replicas is honest, since most pixels have not seen their light: 75 %.)

    The prefixes of one run share samples, so the scatter about the line says nothing about its slope's error;
    replicas are independent, so the jackknife over them does, with its bias correction: Tukey 1958; Efron 1982, "The
    Jackknife, the Bootstrap and Other Resampling Plans", chapter 2.

    An error that is zero, negative or not finite arises where the noise of the reference, which is subtracted, exceeds
    what was measured. A prefix at which that happens in *any* replica is left out of *all*: dropping the one replica
    would keep those that happened to be high and bend the line upwards. HarnessError when shapes do not match, spp is
    not positive, or confidence is outside (0, 1).
    """
    x, squares = _usable(spp, rmse, confidence)
    replicas, points = squares.shape
    if points < 2:
        return Slope(math.nan, -math.inf, math.inf, confidence, replicas, math.nan, points)
    _, value, half = jackknife(lambda chosen: _line(x, chosen)[0], squares, confidence)
    return Slope(value, value - half, value + half, confidence, replicas, _exp(_line(x, squares)[1]), points)


def slope_verdict(slope: Slope, expected: tuple[float, ...] = (-0.5,), tolerance: float = 0.05) -> Outcome:
    """Does the error fall as spp^expected? pass: the slope's whole interval is within ±tolerance; fail: none of it is.

    The default is the Monte Carlo rate: the error of a mean of N independent samples falls as N^(-1/2). Of samples that
    are spread evenly several rates are expected, -1 of smooth pixels, -3/4 of edges, -1/2 of what hangs on many
    numbers, and an image is a mixture of these: its slope lies between them, ±tolerance. HarnessError for a negative
    tolerance.
    """
    if not tolerance >= 0:
        raise HarnessError(f"slope tolerance must be zero or more, found {tolerance}")
    low, high = min(expected) - tolerance, max(expected) + tolerance
    if low <= slope.low and slope.high <= high:
        return "pass"
    if slope.low > high or slope.high < low:
        return "fail"
    return "inconclusive"


@dataclass(frozen=True)
class Reach:
    """How much it takes until an error is reached: samples per pixel, or seconds, with the confidence interval.

    `extrapolated`: 'below' or 'above' where that lies outside the prefixes that were measured, so that it hangs on the
    fitted line going on as it does; empty where it lies among them. Infinite where the error does not fall, NaN where
    nothing could be fitted.
    """

    value: float
    low: float
    high: float
    extrapolated: Literal["", "below", "above"]


def spp_to_reach(spp: np.ndarray, rmse: np.ndarray, target: float,
                 confidence: float = 0.95) -> tuple[float, float, float]:
    """Samples per pixel at which the fitted power law meets `target`, with its interval: (value, low, high).

    The line of `fit_slope` is solved for the target; the interval is the jackknife's, of the logarithm, so it is
    asymmetric. Extrapolates where the target lies outside the measured range. All three are infinite where the error
    does not fall, with or without some replica; the interval is (0, inf) with a single replica; all are NaN when there
    are fewer than two usable prefixes (see `fit_slope`). HarnessError for a target that is not positive and finite,
    and as `fit_slope`.
    """
    return _to_reach(spp, rmse, target, None, confidence)


def samples_to_reach(spp: np.ndarray, rmse: np.ndarray, target: float, confidence: float = 0.95) -> Reach:
    """`spp_to_reach`, and whether the target lies within the curve. HarnessError as there."""
    return Reach(*spp_to_reach(spp, rmse, target, confidence), _outside(spp, rmse, target, confidence))


def seconds_to_reach(spp: np.ndarray, rmse: np.ndarray, seconds: np.ndarray, target: float,
                     confidence: float = 0.95) -> Reach:
    """Seconds until the fitted power law meets `target`: samples times what one takes, `seconds` (R,) of each replica.

    Errors and seconds of one replica are left out together, so that the interval knows of the spread of both. NaN where
    the seconds of some replica are not known. HarnessError as `spp_to_reach`.
    """
    return Reach(*_to_reach(spp, rmse, target, np.asarray(seconds, dtype=np.float64), confidence),
                 _outside(spp, rmse, target, confidence))


def fitted_end(spp: np.ndarray, rmse: np.ndarray) -> float:
    """The error of the fitted line at the last prefix: steadier than the last point alone. NaN where none is fitted.

    HarnessError as `fit_slope`."""
    x, squares = _usable(spp, rmse, 0.95)
    if squares.shape[1] < 2:
        return math.nan
    slope, intercept = _line(x, squares)
    return _exp(intercept + slope * math.log(np.asarray(spp, dtype=np.float64)[-1]))


def _to_reach(spp: np.ndarray, rmse: np.ndarray, target: float, seconds: np.ndarray | None,
              confidence: float) -> tuple[float, float, float]:
    if not 0 < target < math.inf:
        raise HarnessError(f"the error to reach must be positive, found {target}")
    x, squares = _usable(spp, rmse, confidence)
    each = np.ones(len(squares)) if seconds is None else seconds
    if squares.shape[1] < 2 or not (np.isfinite(each) & (each > 0)).all():
        return math.nan, math.nan, math.nan

    def solved(chosen: np.ndarray) -> float:
        slope, intercept = _line(x, chosen[:, :-1])
        samples = (math.log(target) - intercept) / slope if slope < 0 else math.inf
        return samples + math.log(chosen[:, -1].mean())

    value, _, half = jackknife(solved, np.column_stack([squares, each]), confidence)
    if not math.isfinite(value):
        return math.inf, math.inf, math.inf
    return _exp(value), _exp(value - half), _exp(value + half)


def _outside(spp: np.ndarray, rmse: np.ndarray, target: float, confidence: float) -> Literal["", "below", "above"]:
    """By the line through all replicas; rounding does not lead out of the curve."""
    x, squares = _usable(spp, rmse, confidence)
    if squares.shape[1] < 2:
        return ""
    slope, intercept = _line(x, squares)
    reached = intercept + slope * np.log(np.asarray(spp, dtype=np.float64)[[0, -1]]) - math.log(target)
    return "below" if reached[0] < -ROUNDING else "above" if reached[1] > ROUNDING else ""


def band(values: np.ndarray, confidence: float = 0.95, *,
         geometric: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean over replicas and its Student confidence interval at each prefix: (R, P) -> three arrays (P,).

    `geometric` takes mean and interval of the logarithms, as suits quantities drawn on a log axis; a prefix with a
    value that is zero or negative in any replica has no geometric mean and is NaN, a gap in the curve. The interval
    is NaN with a single replica. HarnessError for a confidence outside (0, 1).
    """
    values = np.atleast_2d(np.asarray(values, dtype=np.float64))
    if geometric:
        values = np.log(np.where((values > 0).all(axis=0), values, np.nan))
    mean, half = _mean_and_half_width(values, confidence)
    half = np.where(np.isinf(half), np.nan, half)
    low, high = mean - half, mean + half
    return (np.exp(mean), np.exp(low), np.exp(high)) if geometric else (mean, low, high)


def _usable(spp: np.ndarray, rmse: np.ndarray, confidence: float) -> tuple[np.ndarray, np.ndarray]:
    """log spp (P',) and squared errors (R, P') of the prefixes whose error is positive in every replica."""
    spp = np.asarray(spp, dtype=np.float64)
    rmse = np.atleast_2d(np.asarray(rmse, dtype=np.float64))
    if spp.ndim != 1 or rmse.ndim != 2 or rmse.shape[1] != len(spp):
        raise HarnessError(f"expected errors of shape (replicas, {spp.size}), one for each spp; found {rmse.shape}")
    if not (spp > 0).all():
        raise HarnessError(f"samples per pixel must be positive, found {spp.min():g}")
    check_confidence(confidence)
    usable = (np.isfinite(rmse) & (rmse > 0)).all(axis=0)
    return np.log(spp[usable]), rmse[:, usable] ** 2


def _line(x: np.ndarray, squares: np.ndarray) -> tuple[float, float]:
    """Slope and intercept, on log axes, of the root of the mean over replicas of squared errors (R, P)."""
    y = 0.5 * np.log(squares.mean(axis=0))
    centred = x - x.mean()
    slope = float(y @ centred / (centred @ centred))
    return slope, float(y.mean()) - slope * float(x.mean())


def jackknife(statistic: Callable[[np.ndarray], float], replicas: np.ndarray,
               confidence: float) -> tuple[float, float, float]:
    """A statistic of replicas (R, ...), its bias-corrected value, and half the Student interval over pseudo-values.

    The last is infinite for a single replica; all are where the statistic is not finite. Tukey 1958; Efron 1982.
    """
    count = len(replicas)
    whole = statistic(replicas)
    if count < 2:
        return whole, whole, math.inf
    without = np.array([statistic(np.delete(replicas, index, axis=0)) for index in range(count)])
    if not (math.isfinite(whole) and np.isfinite(without).all()):
        return math.inf, math.inf, math.inf
    mean, half = _mean_and_half_width(count * whole - (count - 1) * without, confidence)
    return whole, float(mean), float(half)


def _mean_and_half_width(values: np.ndarray, confidence: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean over the first axis, and half its Student interval; the latter infinite for a single value."""
    check_confidence(confidence)
    count = len(values)
    mean = values.mean(axis=0)
    if count < 2:
        return mean, np.full_like(mean, np.inf)
    error = values.std(axis=0, ddof=1) / math.sqrt(count)
    return mean, error * special.stdtrit(count - 1, (1 + confidence) / 2)


def _exp(value: float) -> float:
    """exp, infinite rather than an error beyond the range of floats."""
    return math.exp(value) if value < math.log(np.finfo(np.float64).max) else math.inf
