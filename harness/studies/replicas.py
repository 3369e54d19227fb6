"""The replicas of one line of a study: their curves, the estimate that merges them, and what they cost."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from harness import metrics
from harness.errors import HarnessError
from harness.estimators.base import Renderer
from harness.policy import judge
from harness.progress import Advance
from harness.results import StrategyResult
from harness.samples.cost import Cost
from harness.samples.estimate import Accumulator, Batch, Estimate, RunningMean, with_luminance
from harness.samples.spent import spent
from harness.samples.store import Store
from harness.scene import Film, SceneFile
from harness.scene.strategies import Suited
from harness.stats.convergence import fit_slope
from harness.stats.findings import judge_tiles
from harness.stats.tiles import TileAccumulator, TileSamples, tile_size
from harness.studies.plan import Plan, prefix_sizes
from harness.studies.table import measured
from harness.work.batches import batches, equal_batches
from harness.work.run import tiles_of

# A strategy whose standard deviation per sample is below this part of the image's mean is exact: what is left is
# rounding, and in a closed scene the one bounce in 10^7 that slips out at an edge.
EXACT = 1e-3
# Mitsuba's seeds tell so many replicas apart (reference.renderer.REPLICA_BITS).
LAST_REPLICA = 1023
# Points that a slope is fitted to at the least.
SLOPE_POINTS = 3


@dataclass(frozen=True)
class Reference:
    """What strategies are held against: the image with its variance, and its batches as tiles; `looked` as in
    `policy.judge`."""

    estimate: Estimate
    tiles: TileSamples
    looked: int | None = None


class Replicas:
    """One strategy's replicas so far: their curves, the merged estimate, the cost.

    Where samples can be drawn in any portion, a replica's curve is that of its prefixes. Where each replica is a whole
    run with a seed of its own (`Traits.streams`), each point of its curve is another run, with its own seed and as many
    samples, and only the longest are merged; of images that are there it is the one point that they are.
    `downwards`: replicas are numbered from the last one down, lest Mitsuba's be those of its own reference.
    """

    def __init__(self, strategy: Suited, scene: Film, renderer: Renderer, reference: Reference, spp: int,
                 *, downwards: bool = False) -> None:
        self.strategy, self.scene, self.renderer, self.reference = strategy, scene, renderer, reference
        self.downwards = downwards
        traits = renderer.traits
        self.whole_runs = traits.streams == "runs"
        self.spp = traits.spp or spp
        self.prefixes = [self.spp] if traits.spp else prefix_sizes(self.spp)
        self.replicas = 0
        self.curves: list[list[dict[str, float]]] = []  # per replica that has one, per prefix: metrics by name
        self.total = Accumulator()
        self.looked: int | None = None  # batches when it was first decided to draw more
        self.tiles = TileAccumulator(tile_size(scene.height, scene.width))
        # Of each replica the seconds per sample of its longest batches, by device.
        self.seconds: list[dict[str, list[float]]] = []

    def samples(self, *, curve: bool) -> int:
        """Per pixel, that one replica draws."""
        return sum(self.prefixes) if self.whole_runs and curve else self.spp

    def numbers(self, count: int) -> range:
        """The numbers of the next so many replicas, as the renderer counts them."""
        first = self.replicas
        if self.downwards:
            return range(LAST_REPLICA - first, LAST_REPLICA - first - count, -1)
        return range(first, first + count)

    def allowed(self, replicas: int) -> int:
        """So many replicas, or as many as there are. HarnessError for one run alone of which no noise is known."""
        limit = self.renderer.traits.replicas
        found = replicas if limit is None else min(replicas, limit)
        if found < 2 and self.renderer.traits.fixed is None:
            raise HarnessError(f"{self.strategy.name}: one render without variance, from which nothing can be told of "
                               "its noise; name several, each with a seed of its own: 'mine_*.exr'")
        return found

    def add_replica(self, store: Store | None, advance: Advance, *, curve: bool) -> None:
        """Draw the next one, or read it from the store; with its curve, whose metrics cost as much as some samples, or
        for the verdict alone."""
        costs = _Costs()
        points = self._add_runs(costs, advance, curve) if self.whole_runs else self._add_stream(costs, store, advance,
                                                                                                curve)
        self.seconds.append(costs.seconds)
        self.replicas += 1
        if curve:
            self.curves.append(points)

    def _add_stream(self, costs: _Costs, store: Store | None, advance: Advance, curve: bool) -> list[dict[str, float]]:
        prefix = RunningMean()
        points: list[dict[str, float]] = []

        def measured() -> Iterator[Batch]:  # batches pass through, so that no run is ever held whole
            for batch in batches(self.renderer, self.spp, replica=self.numbers(1)[0], store=store, advance=advance,
                                 prefixes=curve):
                costs.add(batch.samples, batch.cost)
                if curve:
                    with spent("statistics"):
                        prefix.add(batch)
                if curve and prefix.samples in self.prefixes:
                    points.append(self._metrics(prefix.mean))
                yield batch

        # For tiles as well: of uneven sizes, yet more of them and so sharper than if all were made as long as the last.
        independent = self.renderer.traits.independent_batches
        for batch in equal_batches(measured(), self.spp, independent=independent):
            self._merge(batch)
        return points

    def _add_runs(self, costs: _Costs, advance: Advance, curve: bool) -> list[dict[str, float]]:
        """Nothing of it is kept: what a program is made of, nobody knows, and images are kept where they are."""
        first = self.replicas * len(self.prefixes)  # of a program and of images replicas count from 0
        points: list[dict[str, float]] = []
        for index, count in enumerate(self.prefixes):
            last = index == len(self.prefixes) - 1
            if not (curve or last):
                continue
            batch = self.renderer.render_batch(first + index, 0, count)
            if curve:
                points.append(self._metrics(batch.mean))
            if last:
                self._merge(batch)
                costs.add(batch.samples, batch.cost)
            advance(count)
        return points

    def _metrics(self, mean: np.ndarray) -> dict[str, float]:
        return metrics.measure(mean, self.reference.estimate, self.scene.exposure, at_prefixes=True)

    @spent("statistics")
    def _merge(self, batch: Batch) -> None:
        self.total.add(batch)
        self.tiles.add(with_luminance(batch.mean), batch.samples)

    @spent("statistics")
    def result(self, plan: Plan, file: SceneFile, expected: tuple[float, ...] = (-0.5,)) -> StrategyResult:
        """What was measured, and what is judged from it."""
        fixed = self.renderer.traits.fixed  # files that know their own variance
        merged = fixed or self.total.estimate()
        tiles = self.tiles.samples() if fixed is None else tiles_of(merged, self.reference.tiles.tile)
        strategy, scene, reference = self.strategy, self.scene, self.reference.estimate
        curves = {name: np.array([[point[name] for point in curve] for curve in self.curves])
                  for name in self.curves[0][0]}
        spp = np.array(self.prefixes)
        devices = {device for each in self.seconds for device in each}
        device = next(iter(devices)) if len(devices) == 1 else ""  # never across machines
        every = [each.get(device, []) if device else [] for each in self.seconds]
        flat = [seconds for each in every for seconds in each]
        return StrategyResult(
            strategy=strategy.name, suits=strategy.suits, warning=strategy.warning,
            measured=measured(file.path.stem, file.given, strategy.name, samples=merged.samples, spp=spp,
                              curves=curves, seconds_per_spp=float(np.median(flat)) if flat else math.nan,
                              replica_seconds=[float(np.median(each)) if each else math.nan
                                               for each in every[:len(self.curves)]],
                              rejected=merged.rejected, device=device,
                              scores=metrics.measure(merged.mean, reference, scene.exposure, at_prefixes=False)),
            estimate=merged,
            verdict=judge(merged, reference, tolerance=plan.tolerance.mean, confidence=plan.confidence,
                          fail_level=plan.fail_level, looked=(self.looked, self.reference.looked)),
            tiles=judge_tiles(tiles, self.reference.tiles, plan.tolerance, fail_level=plan.fail_level,
                              pass_level=1 - plan.confidence),
            slope=None if len(spp) < SLOPE_POINTS or _is_exact(merged) else fit_slope(spp, curves["rmse"]),
            expected=expected)


class _Costs:
    """Seconds per sample of the longest batches of a replica, by device."""

    def __init__(self) -> None:
        self.longest = 0
        self.seconds: dict[str, list[float]] = {}

    def add(self, samples: int, cost: Cost) -> None:
        if samples > self.longest:
            self.longest, self.seconds = samples, {}
        if samples == self.longest:
            self.seconds.setdefault(cost.device, []).append(cost.seconds / samples)


def _is_exact(estimate: Estimate) -> bool:
    deviation = math.sqrt(float(np.mean(estimate.variance)) * estimate.samples)
    return deviation <= EXACT * float(np.mean(estimate.mean))
