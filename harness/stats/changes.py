"""What differs between two measurements of one thing: each from independent replicas, each with its own spread."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import special

from harness.stats.convergence import fit_slope, jackknife

# The confidence at which the spread of one side is taken from a jackknife; any other would give the same spread.
_CONFIDENCE = 0.95


@dataclass(frozen=True)
class Measured:
    """A value with its standard error and its degrees of freedom; NaN where that is unknown."""

    value: float
    error: float
    dof: float


@dataclass(frozen=True)
class Difference:
    """B less A, with the interval at the level that was asked for. NaN where either side is unknown.

    `changed`: None where nothing can be told.
    """

    value: float
    low: float
    high: float

    @property
    def changed(self) -> bool | None:
        """Whether the interval leaves zero out."""
        return None if math.isnan(self.low) or math.isnan(self.high) else self.low > 0 or self.high < 0


def difference(before: Measured, after: Measured, level: float) -> Difference:
    """`after` less `before`, independent of each other, with the two-sided interval that zero leaves by chance with
    probability `level` (Welch 1947, degrees of freedom by Satterthwaite 1946).

    Two sides that share samples are no more different than independent ones would be, so it errs to the safe side. Of
    two values without any spread the difference is what it is.
    """
    value = after.value - before.value
    variances = np.array([before.error**2, after.error**2])
    if not np.isfinite([value, *variances]).all():
        return Difference(value, math.nan, math.nan)
    total = float(variances.sum())
    if total == 0:
        return Difference(value, value, value)
    dofs = np.array([before.dof, after.dof])
    if (dofs[variances > 0] < 1).any():
        return Difference(value, math.nan, math.nan)
    spread = float((variances**2 / np.where(np.isinf(dofs), math.inf, np.maximum(dofs, 1.0))).sum())
    quantile = special.stdtrit(total**2 / spread, 1 - level / 2) if spread > 0 else -special.ndtri(level / 2)
    half = float(quantile * math.sqrt(total))
    return Difference(value, value - half, value + half)


def from_interval(value: float, low: float, high: float, confidence: float, dof: float) -> Measured:
    """A measurement from its interval at a confidence, as if it were Student's: one that skewness made longer gives a
    standard error that is larger than it was."""
    half = (high - low) / 2
    quantile = special.stdtrit(dof, (1 + confidence) / 2) if math.isfinite(dof) else special.ndtri((1 + confidence) / 2)
    return Measured(value, half / float(quantile), dof)


def log_error(rmse: np.ndarray) -> Measured:
    """The logarithm of the root of the mean squared error of replicas (R,)."""
    return _jackknifed(lambda squares: 0.5 * math.log(squares.mean()), np.asarray(rmse, dtype=np.float64) ** 2)


def log_efficiency(samples: int, rmse: np.ndarray, seconds: np.ndarray) -> Measured:
    """The logarithm of 1 / (samples × squared error × seconds of a sample) of replicas, (R,) each."""
    runs = np.column_stack([samples * np.asarray(rmse, dtype=np.float64) ** 2, seconds])
    return _jackknifed(lambda chosen: -float(np.log(chosen.mean(axis=0)).sum()), runs)


def log_seconds(seconds: np.ndarray) -> Measured:
    """The logarithm of the seconds that a sample takes, of replicas (R,)."""
    return _jackknifed(lambda chosen: math.log(chosen.mean()), np.asarray(seconds, dtype=np.float64))


def slope(spp: np.ndarray, rmse: np.ndarray) -> Measured:
    """The slope of the error (R, P) at prefixes (P,), as `fit_slope`."""
    found = fit_slope(spp, rmse, _CONFIDENCE)
    return from_interval(found.slope, found.low, found.high, _CONFIDENCE, found.replicas - 1)


def _jackknifed(statistic: Callable[[np.ndarray], float], replicas: np.ndarray) -> Measured:
    """A statistic of positive numbers; NaN where one is zero, negative or unknown, or where one replica is alone."""
    count = len(replicas)
    if count < 2 or not (np.isfinite(replicas) & (replicas > 0)).all():
        return Measured(math.nan, math.nan, max(count - 1, 0))
    _, value, half = jackknife(statistic, replicas, _CONFIDENCE)
    return from_interval(value, value - half, value + half, _CONFIDENCE, count - 1)
