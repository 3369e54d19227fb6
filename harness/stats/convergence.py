"""How fast does an error fall with samples? Power-law fits, equal-error costs and bands, over independent replicas."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

from harness.errors import HarnessError
from harness.stats.bias import Outcome, check_confidence


@dataclass(frozen=True)
class Slope:
    """The power law error = coefficient x spp^slope, with the slope's confidence interval over the replicas.

    `coefficient` is the law's error at one sample per pixel, the geometric mean over replicas, in the error's unit.
    `points` counts the prefixes that the fit uses. With a single replica the interval is infinite; with fewer than
    two usable prefixes slope and coefficient are NaN.
    """

    slope: float
    low: float
    high: float
    confidence: float
    replicas: int
    coefficient: float
    points: int


def fit_slope(spp: np.ndarray, rmse: np.ndarray, confidence: float = 0.95) -> Slope:
    """Fit a power law to each replica's error by least squares on log-log axes, and average over replicas.

    `spp` (P,), `rmse` (R, P) or (P,). The prefixes of one run share samples, so the scatter about one fitted line
    says nothing about its slope's error; replicas are independent, so the Student interval over their slopes does.

    An error that is zero, negative or not finite has no logarithm. It arises where the noise of the reference, which
    is subtracted, exceeds what was measured. A prefix at which that happens in *any* replica is left out of *all*:
    dropping the one replica would keep those that happened to be high and bend the line upwards. HarnessError when
    shapes do not match, spp is not positive, or confidence is outside (0, 1).
    """
    slopes, intercepts, points = _lines(spp, rmse, confidence)
    if points < 2:
        return Slope(math.nan, -math.inf, math.inf, confidence, len(slopes), math.nan, points)
    mean, half = _mean_and_half_width(slopes, confidence)
    return Slope(float(mean), float(mean - half), float(mean + half), confidence, len(slopes),
                 float(np.exp(intercepts.mean())), points)


def slope_verdict(slope: Slope, expected: float = -0.5, tolerance: float = 0.05) -> Outcome:
    """Does the error fall as spp^expected? pass: the slope's whole interval is within ±tolerance; fail: none of it is.

    The default is the Monte Carlo rate: the error of a mean of N independent samples falls as N^(-1/2). HarnessError
    for a negative tolerance.
    """
    if not tolerance >= 0:
        raise HarnessError(f"slope tolerance must be zero or more, found {tolerance}")
    low, high = expected - tolerance, expected + tolerance
    if low <= slope.low and slope.high <= high:
        return "pass"
    if slope.low > high or slope.high < low:
        return "fail"
    return "inconclusive"


def spp_to_reach(spp: np.ndarray, rmse: np.ndarray, target: float,
                 confidence: float = 0.95) -> tuple[float, float, float]:
    """Samples per pixel at which the fitted power law meets `target`, with its interval: (value, low, high).

    Each replica's own line is solved for the target and the results averaged as logarithms, so the value is a
    geometric mean and the interval, Student over replicas, is asymmetric. Extrapolates where the target lies outside
    the measured range. All three are infinite when some replica's error does not fall; the interval is (0, inf) with
    a single replica; all are NaN when there are fewer than two usable prefixes (see `fit_slope`). HarnessError for a
    target that is not positive and finite, and as `fit_slope`.
    """
    if not 0 < target < math.inf:
        raise HarnessError(f"the error to reach must be positive, found {target}")
    slopes, intercepts, points = _lines(spp, rmse, confidence)
    if points < 2:
        return math.nan, math.nan, math.nan
    if (slopes >= 0).any():
        return math.inf, math.inf, math.inf
    mean, half = _mean_and_half_width((math.log(target) - intercepts) / slopes, confidence)
    return _exp(float(mean)), _exp(float(mean - half)), _exp(float(mean + half))


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


def _lines(spp: np.ndarray, rmse: np.ndarray, confidence: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Slope and intercept of each replica's line on log axes, (R,) each, and the number of prefixes used."""
    spp = np.asarray(spp, dtype=np.float64)
    rmse = np.atleast_2d(np.asarray(rmse, dtype=np.float64))
    if spp.ndim != 1 or rmse.ndim != 2 or rmse.shape[1] != len(spp):
        raise HarnessError(f"expected errors of shape (replicas, {spp.size}), one for each spp; found {rmse.shape}")
    if not (spp > 0).all():
        raise HarnessError(f"samples per pixel must be positive, found {spp.min():g}")
    check_confidence(confidence)
    usable = (np.isfinite(rmse) & (rmse > 0)).all(axis=0)
    points = int(usable.sum())
    if points < 2:
        nothing = np.full(len(rmse), np.nan)
        return nothing, nothing, points
    x, y = np.log(spp[usable]), np.log(rmse[:, usable])
    centred = x - x.mean()
    slopes = y @ centred / (centred @ centred)
    return slopes, y.mean(axis=1) - slopes * x.mean(), points


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
