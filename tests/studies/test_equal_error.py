"""Equal error: exact power laws give exact factors, and unsuitable or exact strategies take no part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness.results import StrategyResult, StudyResult
from harness.stats.convergence import fit_slope
from harness.studies.equal_error import equal_error
from tests.support.report import with_measured


def power_law(strategy: StrategyResult, coefficient: float, seconds: float, spread: float = 0.0) -> StrategyResult:
    """The strategy with RMSE = coefficient / sqrt(spp), its replicas `spread` apart (relative)."""
    factors = 1 + spread * np.linspace(-1, 1, strategy.curves["rmse"].shape[0])
    rmse = coefficient * factors[:, None] / np.sqrt(strategy.spp)[None, :]
    return replace(with_measured(strategy, curves={**strategy.curves, "rmse": rmse}, seconds_per_spp=seconds),
                   slope=fit_slope(strategy.spp, rmse))


def test_exact_power_laws_give_exact_factors(study: StudyResult) -> None:
    """A third of the noise needs a ninth of the samples; twice the time per sample halves the gain in time."""
    uniform, cosine, *_ = study.strategies
    found = equal_error(replace(study, strategies=(power_law(uniform, 0.6, 0.01), power_law(cosine, 0.2, 0.02))))
    assert found is not None and found.baseline == "uniform"
    assert found.rmse == pytest.approx(0.6 / np.sqrt(uniform.spp[-1]))
    base, other = found.costs
    assert base.sample_gain is None and base.time_gain is None
    assert base.spp.value == pytest.approx(uniform.spp[-1])
    assert base.seconds.value == pytest.approx(0.01 * uniform.spp[-1])
    assert other.spp.value == pytest.approx(uniform.spp[-1] / 9)
    assert other.sample_gain is not None and other.sample_gain.value == pytest.approx(9)
    assert other.time_gain is not None and other.time_gain.value == pytest.approx(4.5)
    assert other.variance_ratio is not None and other.variance_ratio.value == pytest.approx(9)


def test_intervals_widen_with_the_scatter_of_either_side(study: StudyResult) -> None:
    uniform, cosine, *_ = study.strategies

    def width(first: float, second: float) -> float:
        pair = power_law(uniform, 0.6, 0.01, first), power_law(cosine, 0.2, 0.01, second)
        found = equal_error(replace(study, strategies=pair))
        assert found is not None
        gain = found.costs[1].sample_gain
        assert gain is not None and gain.low <= gain.value <= gain.high
        return gain.high / gain.low

    assert width(0, 0) == pytest.approx(1)
    assert 1.01 < width(0.05, 0) == pytest.approx(width(0, 0.05), rel=1e-2)
    assert width(0.05, 0.05) > 1.2 * width(0, 0.05)


def test_the_common_error_is_reached_by_every_strategy_within_its_run(study: StudyResult) -> None:
    found = equal_error(study)
    assert found is not None
    assert all(cost.spp.value <= 1.02 * cost.strategy.spp[-1] for cost in found.costs)


def test_only_suitable_strategies_with_a_slope_take_part(study: StudyResult, exact: StudyResult) -> None:
    found = equal_error(study)
    assert found is not None
    assert [cost.strategy.strategy for cost in found.costs] == ["uniform", "cosine", "lobes", "mixture"]
    assert equal_error(exact) is None, "uniform alone has nothing to be compared with"


def test_the_first_strategy_is_the_baseline_where_uniform_is_missing(study: StudyResult) -> None:
    found = equal_error(replace(study, strategies=study.strategies[3:]))
    assert found is not None and found.baseline == "lobes"


def test_seconds_of_two_devices_have_no_ratio(study: StudyResult) -> None:
    uniform, cosine, *_ = study.strategies
    slow, fast = power_law(uniform, 0.6, 0.01), with_measured(power_law(cosine, 0.2, 0.02), device="another")
    found = equal_error(replace(study, strategies=(slow, fast)))
    assert found is not None
    gain, samples = found.costs[1].time_gain, found.costs[1].sample_gain
    assert gain is not None and np.isnan(gain.value)
    assert samples is not None and samples.value == pytest.approx(9)
