"""What the benchmark measured."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class BenchRow:
    """A measured case of `harness bench`. Rates in million samples (paths) per second, medians over the rounds, by the
    clock that counts on the device (`samples.cost.Cost.seconds`).

    `ratio`: tracer's rate over the opponent's, the median of the rounds' own ratios, `low` and `high` their extremes.
    `wall_ratio`: the same by elapsed time. `efficiency_ratio`: of 1 / (variance x time), so it also counts how noisy a
    sample is: how much faster the tracer reaches the same error.
    """

    scene: str
    strategy: str
    opponent: str
    needed: float
    tracer_rate: float
    opponent_rate: float
    ratio: float
    low: float
    high: float
    wall_ratio: float
    efficiency_ratio: float


@dataclass(frozen=True)
class SamplerRow:
    """One of Mitsuba's samplers in the benchmark, under the integrator `integrator`, `spp` samples per pixel a replica.

    `gain`: how much sooner than with Mitsuba's independent sampler the same error is reached, by the clock that counts;
    `best`: whether no other gains more. `ratio`: how much sooner the tracer reaches it than Mitsuba does with this one,
    `low` and `high`: its 95 % interval over replicas.
    """

    scene: str
    strategy: str
    integrator: str
    sampler: str
    spp: int
    best: bool
    gain: float
    ratio: float
    low: float
    high: float


@dataclass(frozen=True)
class Benchmark:
    """All that `harness bench` measured."""

    rows: tuple[BenchRow, ...] = ()
    samplers: tuple[SamplerRow, ...] = ()
