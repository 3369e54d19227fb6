"""What an error costs each line of a study: samples and seconds until it is reached, and time to unit variance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.errors import HarnessError
from harness.results import StrategyResult, StudyResult
from harness.stats.convergence import Reach, fitted_end, samples_to_reach, seconds_to_reach
from harness.stats.efficiency import Factor, time_to_unit_variance


@dataclass(frozen=True)
class Costs:
    """One line of a study: `samples` per pixel and `seconds` until the common error is reached, and `ttuv`, the
    variance of one sample times its seconds; each with an interval over replicas, None where it cannot be told.

    `ttuv` has a meaning where samples are independent: it is None where they are spread evenly.
    """

    estimator: str
    samples: Reach | None
    seconds: Reach | None
    ttuv: Factor | None


@dataclass(frozen=True)
class CostsOfStudy:
    """`rmse`: the error at which costs are told, in radiance; None where no line has a curve to fit. `asked`: whether
    somebody asked for it, relative to the mean; otherwise it is the largest that a line ends with."""

    rmse: float | None
    asked: bool
    lines: tuple[Costs, ...]


def costs_of(study: StudyResult) -> CostsOfStudy:
    """Costs of every line at the error that the study was asked for, or at one that every line that suits reaches.

    Where a curve does not come to the error, the fitted line goes on and `Reach.extrapolated` says so. Intervals are
    the jackknife's over replicas, at the confidence of the study's slopes.
    """
    error = None if study.error is None else study.error * study.brightness
    if error is None:
        ends = [fitted_end(item.spp, item.curves["rmse"]) for item in study.strategies if item.suits and _fits(item)]
        error = max(ends, default=None)
    return CostsOfStudy(error, study.error is not None, tuple(_costs(item, error) for item in study.strategies))


def require_error(error: float | None) -> None:
    """HarnessError unless an error that costs are told at is positive."""
    if error is not None and not 0 < error < np.inf:
        raise HarnessError(f"the error at which costs are told must be positive (0.05: an RMSE of 5 % of the mean), "
                           f"found {error:g}")


def _fits(item: StrategyResult) -> bool:
    return item.slope is not None and item.slope.points >= 2


def _costs(item: StrategyResult, error: float | None) -> Costs:
    samples = seconds = None
    rmse = item.curves["rmse"]
    confidence = item.verdict.confidence
    known = bool(np.isfinite(item.replica_seconds).all())
    if error is not None and _fits(item):
        samples = samples_to_reach(item.spp, rmse, error, confidence)
        seconds = seconds_to_reach(item.spp, rmse, item.replica_seconds, error, confidence) if known else None
    alone = min(item.expected) == max(item.expected)
    ttuv = None
    if alone and known:
        found = time_to_unit_variance(item.spp, rmse, item.replica_seconds, confidence)
        ttuv = found if np.isfinite(found.value) else None
    return Costs(item.strategy, samples, seconds, ttuv)
