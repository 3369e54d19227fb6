"""What equal error costs: samples and CPU time that each strategy needs to reach one RMSE, and the factors between."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from harness.results import StrategyResult, StudyResult
from harness.stats.convergence import spp_to_reach

BASELINE = "uniform"


@dataclass(frozen=True)
class Factor:
    """A positive number with its confidence interval."""

    value: float
    low: float
    high: float

    def over(self, other: Factor) -> Factor:
        """self / other for independent estimates: half widths add in quadrature on a log scale."""
        value = self.value / other.value
        down = math.hypot(math.log(self.value / self.low), math.log(other.high / other.value))
        up = math.hypot(math.log(self.high / self.value), math.log(other.value / other.low))
        return Factor(value, value * math.exp(-down), value * math.exp(up))

    def times(self, scale: float) -> Factor:
        """self × a number that is taken as exact."""
        return Factor(self.value * scale, self.low * scale, self.high * scale)


@dataclass(frozen=True)
class Cost:
    """What one strategy pays for the common error: samples per pixel and CPU seconds, and the baseline's over its own.

    `sample_gain`, `time_gain`: how many times fewer than the baseline needs; None for the baseline itself.
    """

    strategy: StrategyResult
    spp: Factor
    cpu_seconds: Factor
    sample_gain: Factor | None
    time_gain: Factor | None


@dataclass(frozen=True)
class EqualError:
    """The common error (RMSE, radiance unit), the strategy that the others are held against, and everybody's costs."""

    rmse: float
    baseline: str
    costs: tuple[Cost, ...]


def equal_error(result: StudyResult) -> EqualError | None:
    """Costs of all suitable strategies with a fitted slope at one error; None where there are none.

    The error is the largest that any of them still has at the end of its run, so that each reaches it within what
    was measured. The baseline is `uniform`, or the first strategy where that does not suit. CPU time per sample is
    taken as exact: its spread is far below that of the samples.
    """
    fitted = [strategy for strategy in result.strategies if strategy.suits and strategy.slope is not None]
    if not fitted:
        return None
    target = max(_final_rmse(strategy) for strategy in fitted)
    baseline = next((strategy for strategy in fitted if strategy.strategy == BASELINE), fitted[0])
    needs = {strategy.strategy: _needed(strategy, target) for strategy in fitted}
    costs = []
    for strategy in fitted:
        spp = needs[strategy.strategy]
        time = spp.times(strategy.cpu_seconds_per_spp)
        base = needs[baseline.strategy]
        other = strategy is not baseline
        costs.append(Cost(strategy, spp, time, base.over(spp) if other else None,
                          base.times(baseline.cpu_seconds_per_spp).over(time) if other else None))
    return EqualError(target, baseline.strategy, tuple(costs))


def _final_rmse(strategy: StrategyResult) -> float:
    """The fitted line's RMSE at the end of the run: steadier than the last point alone."""
    assert strategy.slope is not None
    return float(strategy.slope.coefficient * float(strategy.spp[-1]) ** strategy.slope.slope)


def _needed(strategy: StrategyResult, target: float) -> Factor:
    value, low, high = spp_to_reach(strategy.spp, strategy.rmse, target)
    return Factor(float(value), float(low), float(high))
