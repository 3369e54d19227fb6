"""Costs of an error: power laws of which the answer is known, and the sober word where a curve does not reach it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.stats.convergence import samples_to_reach, seconds_to_reach
from harness.stats.efficiency import time_to_unit_variance
from harness.studies.costs import costs_of, require_error
from tests.support.studies import SPP, line, study


def test_of_a_power_law_are_what_it_says() -> None:
    """RMSE = 0.8 N^(-1/2): 0.2 (40 % of a mean of 0.5) takes 16 samples; each takes 0.01 s and has a variance 0.64."""
    costs, = costs_of(study(line("uniform", error=0.8), error=0.4)).lines
    assert costs.samples and costs.seconds and costs.ttuv
    assert costs.samples.low < 16 < costs.samples.high and costs.samples.extrapolated == ""
    assert costs.seconds.low < 0.16 < costs.seconds.high
    assert costs.ttuv.low < 0.0064 < costs.ttuv.high
    for found in (costs.samples, costs.seconds, costs.ttuv):
        assert 1 < found.high / found.low < 1.2


@pytest.mark.parametrize(("error", "told"), [(0.01, "above"), (0.4, ""), (4.0, "below")])
def test_beyond_the_curve_are_extrapolated_and_say_so(error: float, told: str) -> None:
    costs, = costs_of(study(line("uniform", error=0.8), error=error)).lines
    assert costs.samples and costs.seconds
    assert (costs.samples.extrapolated, costs.seconds.extrapolated) == (told, told)
    assert costs.samples.value == pytest.approx((0.8 / (0.5 * error)) ** 2, rel=0.1)


def test_are_told_at_an_error_that_every_line_reaches_unless_somebody_asks() -> None:
    found = costs_of(study(line("uniform", error=0.8), line("mixture", error=0.2)))
    assert found.rmse == pytest.approx(0.8 / 8, rel=0.05) and not found.asked
    slow, fast = found.lines
    assert slow.samples and fast.samples
    assert (slow.samples.extrapolated, fast.samples.extrapolated) == ("", "")
    assert slow.samples.value / fast.samples.value == pytest.approx(16, rel=0.2)


def test_of_lines_that_do_not_fall_are_never() -> None:
    costs, = costs_of(study(line("uniform", slope=0.0, spread=0.0), error=0.1)).lines
    assert costs.samples and costs.seconds and np.isinf([costs.samples.value, costs.seconds.value]).all()


def test_of_samples_that_are_spread_evenly_have_no_variance_of_one() -> None:
    sobol = replace(line("mixture sobol", slope=-0.75), expected=(-1.0, -0.75, -0.5))
    costs, = costs_of(study(sobol, error=0.2)).lines
    assert costs.samples and costs.ttuv is None


def test_of_images_are_none() -> None:
    """One point each, and nobody's clock."""
    images = line("kept", spp=SPP[-1:], seconds=float("nan"))
    found = costs_of(study(images))
    assert (found.rmse, found.lines[0].samples, found.lines[0].seconds, found.lines[0].ttuv) == (None,) * 4


def test_seconds_of_several_devices_are_not_told_but_samples_are() -> None:
    costs, = costs_of(study(line("uniform", seconds=float("nan")), error=0.2)).lines
    assert costs.samples and costs.seconds is None and costs.ttuv is None


def test_an_error_must_be_positive() -> None:
    with pytest.raises(HarnessError, match="must be positive"):
        require_error(0.0)


class TestIntervals:
    """Errors and seconds of one replica are left out together."""

    def coverage(self, inside: object) -> float:
        random = np.random.default_rng(5)
        hits = []
        for _ in range(300):
            noise = np.exp(0.1 * random.standard_normal((6, 1)))
            rmse = noise * SPP**-0.5 * np.exp(0.03 * random.standard_normal((6, len(SPP))))
            seconds = 0.01 * np.exp(0.2 * random.standard_normal(6))
            hits.append(inside(rmse, seconds))  # type: ignore[operator]
        return float(np.mean(hits))

    def test_of_seconds_hold_the_truth_as_often_as_they_say(self) -> None:
        """At 6 replicas. The mean squared error is e^(2 · 0.1² + 2 · 0.03²), the mean second e^(0.2² / 2)."""
        truth = 100 * np.exp(2 * 0.1**2 + 2 * 0.03**2) * 0.01 * np.exp(0.2**2 / 2)

        def inside(rmse: np.ndarray, seconds: np.ndarray) -> bool:
            found = seconds_to_reach(SPP, rmse, seconds, 0.1)
            return found.low < truth < found.high

        assert 0.9 < self.coverage(inside) < 0.99

    def test_of_the_time_to_unit_variance_too(self) -> None:
        truth = np.exp(2 * 0.1**2 + 2 * 0.03**2) * 0.01 * np.exp(0.2**2 / 2)

        def inside(rmse: np.ndarray, seconds: np.ndarray) -> bool:
            found = time_to_unit_variance(SPP, rmse, seconds)
            return found.low < truth < found.high

        assert 0.9 < self.coverage(inside) < 0.99

    def test_are_without_bound_for_one_replica(self) -> None:
        found = time_to_unit_variance(SPP, SPP**-0.5, np.array([0.01]))
        assert (found.low, found.high) == (0.0, np.inf) and found.value == pytest.approx(0.01)
        assert samples_to_reach(SPP, SPP**-0.5, 0.2).high == np.inf
        with pytest.raises(HarnessError, match=r"expected errors of shape \(2, 7\)"):
            time_to_unit_variance(SPP, np.ones((3, 7)), np.ones(2))
