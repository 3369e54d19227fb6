"""Factors between strategies, with intervals: variance at equal samples, and efficiency, which counts their cost."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from harness.errors import HarnessError
from harness.stats.convergence import jackknife


@dataclass(frozen=True)
class Factor:
    """A positive number with its confidence interval; NaN where unknown, an interval of (0, inf) where unbounded."""

    value: float
    low: float
    high: float

    def over(self, other: Factor) -> Factor:
        """self / other for independent estimates: half widths add in quadrature on a log scale."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ours, theirs = np.log([self.low, self.value, self.high]), np.log([other.low, other.value, other.high])
            centre = ours[1] - theirs[1]
            down = math.hypot(ours[1] - ours[0], theirs[2] - theirs[1])
            up = math.hypot(ours[2] - ours[1], theirs[1] - theirs[0])
            value, low, high = np.exp([centre, centre - down, centre + up])
        return Factor(float(value), float(low), float(high))

    def times(self, scale: float) -> Factor:
        """self × a number that is taken as exact."""
        return Factor(self.value * scale, self.low * scale, self.high * scale)


def sample_variance(spp: np.ndarray, rmse: np.ndarray, confidence: float = 0.95) -> Factor:
    """The variance of one sample, mean over pixels, from the errors (R, P) of R replicas at the prefixes `spp` (P,).

    Samples times squared error of whole runs, the mean over replicas: of all prefixes the whole run has seen most of
    a heavy tail. Its interval is the jackknife's over replicas, of the logarithm; (0, inf) with a single replica.
    NaN where the error of some run is zero or unknown. HarnessError for shapes that do not match.
    """
    rmse = np.atleast_2d(np.asarray(rmse, dtype=np.float64))
    if rmse.shape[1] != np.size(spp):
        raise HarnessError(f"expected errors of shape (replicas, {np.size(spp)}), found {rmse.shape}")
    squares = float(np.asarray(spp)[-1]) * rmse[:, -1] ** 2
    if not (np.isfinite(squares) & (squares > 0)).all():
        return Factor(math.nan, math.nan, math.nan)
    _, value, half = jackknife(lambda chosen: math.log(chosen.mean()), squares, confidence)
    if math.isinf(half):
        return Factor(float(squares.mean()), 0.0, math.inf)
    return Factor(math.exp(value), math.exp(value - half), math.exp(value + half))


def time_to_unit_variance(spp: np.ndarray, rmse: np.ndarray, seconds: np.ndarray, confidence: float = 0.95) -> Factor:
    """Variance of one sample, mean over pixels, times the seconds that one takes: what an efficiency is the inverse of.

    That is how long it takes until the variance is 1 (radiance squared) where samples are independent. `spp` (P,),
    `rmse` (R, P), `seconds` (R,) for one sample per pixel, of each replica. The interval is the jackknife's over
    replicas, of the logarithm: those of errors and seconds are left out together. (0, inf) with a single replica, NaN
    where the error or the seconds of some run are zero or unknown. HarnessError for shapes that do not match.
    """
    rmse = np.atleast_2d(np.asarray(rmse, dtype=np.float64))
    seconds = np.atleast_1d(np.asarray(seconds, dtype=np.float64))
    if rmse.shape != (len(seconds), np.size(spp)):
        raise HarnessError(f"expected errors of shape ({len(seconds)}, {np.size(spp)}), found {rmse.shape}")
    runs = np.column_stack([float(np.asarray(spp)[-1]) * rmse[:, -1] ** 2, seconds])
    if not (np.isfinite(runs) & (runs > 0)).all():
        return Factor(math.nan, math.nan, math.nan)
    whole, value, half = jackknife(lambda chosen: float(np.log(chosen.mean(axis=0)).sum()), runs, confidence)
    if math.isinf(half):
        return Factor(math.exp(whole), 0.0, math.inf)
    return Factor(math.exp(value), math.exp(value - half), math.exp(value + half))
