"""What equal error costs: samples and time that each strategy needs to reach one RMSE, and the factors between."""

from __future__ import annotations

import math
from dataclasses import dataclass
from weakref import WeakKeyDictionary

from harness.results import StrategyResult, StudyResult
from harness.stats.convergence import Slope, spp_to_reach
from harness.stats.efficiency import Factor, sample_variance

BASELINE = "uniform"
# Of studies that are in use: a report's chapters ask five times for each.
_found: WeakKeyDictionary[StudyResult, EqualError | None] = WeakKeyDictionary()


@dataclass(frozen=True)
class Cost:
    """What one strategy pays for the common error: samples per pixel and seconds, and the baseline's over its own.

    `sample_gain`, `time_gain`: how many times less than the baseline it needs; `variance_ratio`: the baseline's
    variance of one sample over its own, which `sample_gain` equals where both converge as N^(-1/2); None for the
    baseline itself, and where samples are spread evenly.
    """

    strategy: StrategyResult
    spp: Factor
    seconds: Factor
    sample_gain: Factor | None
    time_gain: Factor | None
    variance_ratio: Factor | None


@dataclass(frozen=True)
class EqualError:
    """The common error (RMSE, radiance unit), the strategy that the others are held against, and everybody's costs."""

    rmse: float
    baseline: str
    costs: tuple[Cost, ...]


def equal_error(result: StudyResult) -> EqualError | None:
    """Costs of all suitable strategies with a fitted slope at one error; None where fewer than two have one.

    The error is the largest that any of them still has at the end of its run, so that each reaches it within what
    was measured. The baseline is `uniform`, or the first strategy where that has no slope. Intervals have the
    confidence of the slopes; time per sample is taken as exact, its spread being far below that of the samples.
    """
    if result not in _found:
        _found[result] = _equal_error(result)
    return _found[result]


def _equal_error(result: StudyResult) -> EqualError | None:
    fitted = [(s, s.slope) for s in result.strategies if s.suits and s.slope is not None and s.slope.points >= 2]
    if len(fitted) < 2:
        return None
    target = max(_final_rmse(strategy, slope) for strategy, slope in fitted)
    needs = {strategy.strategy: Factor(*spp_to_reach(strategy.spp, strategy.curves["rmse"], target, slope.confidence))
             for strategy, slope in fitted}
    baseline = next((strategy for strategy, _ in fitted if strategy.strategy == BASELINE), fitted[0][0])
    samples = needs[baseline.strategy]
    seconds = samples.times(baseline.seconds_per_spp)
    costs = []
    for strategy, slope in fitted:
        own = needs[strategy.strategy]
        same = strategy.device == baseline.device  # seconds of two devices have no ratio
        time = own.times(strategy.seconds_per_spp)
        if strategy is baseline:
            costs.append(Cost(strategy, own, time, None, None, None))
            continue
        # One sample has a variance of its own where samples are independent.
        alone = all(min(s.expected) == max(s.expected) for s in (baseline, strategy))
        variances = [sample_variance(s.spp, s.curves["rmse"], slope.confidence) for s in (baseline, strategy)]
        faster = seconds.over(time if same else own.times(math.nan))
        costs.append(Cost(strategy, own, time, samples.over(own), faster,
                          variances[0].over(variances[1]) if alone else None))
    return EqualError(target, baseline.strategy, tuple(costs))


def _final_rmse(strategy: StrategyResult, slope: Slope) -> float:
    """The fitted line's RMSE at the end of the run: steadier than the last point alone."""
    return float(slope.coefficient * float(strategy.spp[-1]) ** slope.slope)
