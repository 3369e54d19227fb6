"""What the benchmark measured."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class BenchRow:
    """A measured case of `harness bench`. Rates in million samples (paths) per second, medians over the rounds, by the
    clock that counts on the device (`samples.cost.Cost.seconds`).

    `entry`: which of the tracer's shaders was run, `fragment` or `compute`; empty for the device's own.
    `ratio`: tracer's rate over the opponent's, the median of the rounds' own ratios, `low` and `high` their extremes.
    `wall_ratio`: the same by elapsed time. `efficiency_ratio`: of 1 / (variance x time), so it also counts how noisy a
    sample is: how much faster the tracer reaches the same error.
    """

    scene: str
    strategy: str
    opponent: str
    entry: str
    needed: float
    tracer_rate: float
    opponent_rate: float
    ratio: float
    low: float
    high: float
    wall_ratio: float
    efficiency_ratio: float


@dataclass(frozen=True)
class EntrantRow:
    """One renderer at equal error: the tracer with a strategy and a sampler, or Mitsuba's `path` with one of its own.

    `renderer`: `tracer` or `path`; `strategy`: of the tracer, empty for the other; `spp`: samples per pixel of a
    replica. `ratio`: how much sooner than Mitsuba's best it reaches the same error, by the clock that counts, `low` and
    `high` its 95 % interval over replicas. `best`: whether no other of its renderer is sooner.
    """

    scene: str
    renderer: str
    strategy: str
    sampler: str
    spp: int
    best: bool
    ratio: float
    low: float
    high: float


@dataclass(frozen=True)
class Benchmark:
    """All that `harness bench` measured."""

    rows: tuple[BenchRow, ...] = ()
    entrants: tuple[EntrantRow, ...] = ()
