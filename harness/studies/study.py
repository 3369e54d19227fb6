"""Convergence studies: strategies and samplers on one scene against one reference, as curves, verdicts and costs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from harness import metrics
from harness.errors import HarnessError, SceneError
from harness.estimators.base import Estimator, Renderer
from harness.estimators.mitsuba import Mitsuba
from harness.estimators.tracer import Tracer
from harness.policy import CONFIDENCE, TOLERANCE, fail_level, judge, tolerance_for, tolerances
from harness.progress import Advance, Progress, quiet
from harness.results import StrategyResult, StudyResult
from harness.samples.cost import Cost
from harness.samples.estimate import Accumulator, Batch, Estimate, with_luminance
from harness.samples.spent import spent
from harness.samples.store import Store
from harness.scene import Film, Scene, SceneFile, describe, file_of, load, present
from harness.shader.samplers import DEFAULT, sampler_named
from harness.shader.strategies import Suited, suitable_strategies
from harness.stats.bias import error_scale
from harness.stats.convergence import fit_slope
from harness.stats.findings import judge_tiles
from harness.stats.tiles import TileAccumulator, TileSamples, tile_size
from harness.stats.verdicts import Tolerance
from harness.studies.plan import (
    ENOUGH,
    MAX_REFERENCE_FACTOR,
    MAX_REPLICA_FACTOR,
    PRECISION,
    REFERENCE_FACTOR,
    STAGES,
    STUDENT,
    Plan,
    prefix_sizes,
    replicas_needed,
)
from harness.studies.table import measured
from harness.work.batches import batches, equal_batches
from harness.work.executors import Executor
from harness.work.provenance import versions
from harness.work.run import Run, reference_run, tiles_of
from harness.work.tasks import draw, tasks_of

# Mitsuba's best sampler: at equal cost its replicas have a third to a sixth of the independent one's variance, and they
# stay independent of each other, which is all that variances and verdicts rest on.
REFERENCE_SAMPLER = "multijitter"
# A strategy whose standard deviation per sample is below this part of the image's mean is exact: what is left is
# rounding, and in a closed scene the one bounce in 10^7 that slips out at an edge.
EXACT = 1e-3


def study(scene: Scene | SceneFile, strategies: Sequence[str | Estimator] | None = None, *,
          samplers: Sequence[str] = (DEFAULT,), spp: int = 1024, replicas: int = 8,
          max_replicas: int | None = None, reference_spp: int | None = None, reference: Estimate | None = None,
          tolerance: float | None = None, confidence: float = CONFIDENCE, family: int | None = None,
          store: Store | None = None, executor: Executor | None = None, progress: Progress = quiet) -> StudyResult:
    """Convergence curves, verdict and cost of each strategy on one scene, against one reference.

    `strategies`: of the tracer by name, or any other estimators; all of the tracer's that suit the scene where None.
    `samplers`: of the tracer by name; each strategy that is named is studied with each of them.
    `spp`: samples per pixel of each replica; where `replicas` are too few to decide, more are added, up to
    `max_replicas` (16 x replicas by default), without curves. `reference`: a ready one (closed form, file); otherwise
    Mitsuba renders `reference_spp` samples, 4 x spp by default, and up to 8 times as many where its own noise would
    keep the verdicts from deciding; in replicas whose samples its best sampler spreads evenly. `tolerance`: of the
    mean, tiles having theirs in proportion; those of `tolerance_for` where None. `family`: how many strategies share
    the rate of false alarms, those of this study where None. A study that was interrupted continues from the store.
    `executor`: where batches are drawn, here where None; it needs a `store`, through which they come back. Raises
    HarnessError for an unknown strategy, counts below their minimum, an image too small for SSIM, and a reference of
    another size or with pixels that are not finite.
    """
    if spp < 1:
        raise HarnessError(f"samples per pixel must be at least 1, found {spp}")
    if executor and not store:
        raise HarnessError("an executor hands its batches over through a store; give the study one")
    if replicas < 2:
        raise HarnessError(f"a study needs at least 2 replicas to tell its own uncertainty, found {replicas}")
    file = scene if isinstance(scene, SceneFile) else file_of(scene)
    estimators = _estimators(file, strategies, samplers)
    film, reading = file.film, _reading(file, estimators)
    allowed, reason = _tolerance(reading, tolerance)
    suiting = sum(not estimator.check(file) for estimator in estimators)
    plan = Plan(spp, replicas, max_replicas or MAX_REPLICA_FACTOR * replicas, allowed, confidence,
                 fail_level(family or max(suiting, 1)))
    metrics.require_ssim_size(film.height, film.width)
    kind = "given" if reference else "Mitsuba"
    if reference is None:
        run = _precise_reference(file, reference_spp or REFERENCE_FACTOR * spp, plan.tolerance.mean, store, progress)
        reference, tiles = run.estimate(), run.tiles()
    if reference.mean.shape[:2] != (film.height, film.width):
        raise HarnessError(f"the reference is {reference.mean.shape[1]} x {reference.mean.shape[0]} pixels, the scene "
                           f"{film.width} x {film.height}; render both at the same size")
    if not np.isfinite(reference.mean).all():
        raise HarnessError("the reference holds pixels that are not finite; render it again")
    if kind == "given":
        tiles = tiles_of(reference, tile_size(film.height, film.width))
    results = []
    for estimator in estimators:
        results.append(_study_estimator(file, film, estimator, _Reference(reference, tiles), plan,
                                        _Drawing(store, executor, progress)))
    return StudyResult(
        scene=file.name, description=describe(file.path), scene_hash=_hash(file, reading), exposure=film.exposure,
        reference=reference, reference_kind=kind, strategies=tuple(results),
        notes=(*(present(file).notes if reading else ()), *filter(None, [reason])),
        provenance=_provenance(file, film, reading, plan, reference, kind))


def _estimators(file: SceneFile, named: Sequence[str | Estimator] | None,
                samplers: Sequence[str]) -> tuple[Estimator, ...]:
    """What is studied, each once; HarnessError for two that have one name."""
    found: dict[Estimator, None] = {}
    for name in named or suitable_strategies(load(file)):
        each = [Tracer(name, sampler=sampler) for sampler in samplers] if isinstance(name, str) else [name]
        found |= dict.fromkeys(each)
    called = [estimator.name for estimator in found]
    if twice := next((name for name in called if called.count(name) > 1), None):
        raise HarnessError(f"two of the estimators are called '{twice}'; a study tells them apart by their names")
    return tuple(found)


def _reading(file: SceneFile, estimators: Sequence[Estimator]) -> Scene | None:
    """Our reading of the scene, which none but the tracer needs."""
    try:
        return load(file)
    except SceneError:
        if any(isinstance(estimator, Tracer) for estimator in estimators):
            raise
        return None


def _tolerance(reading: Scene | None, mean: float | None) -> tuple[Tolerance, str]:
    if mean is not None or reading is None:
        return tolerances(TOLERANCE if mean is None else mean), ""
    return tolerance_for(reading)


def _hash(file: SceneFile, reading: Scene | None) -> str:
    """Our reading's where there is one: it knows what of the file does not change the image."""
    return reading.content_hash if reading else file.hash


def _precise_reference(file: SceneFile, spp: int, tolerance: float, store: Store | None, progress: Progress) -> Run:
    """Mitsuba's image, with so many samples that it takes at most half of what the verdicts' intervals may be wide.

    As with replicas (Stein 1945), how many is decided from the variance of the first `spp` alone.
    """
    with Mitsuba(sampler=REFERENCE_SAMPLER).open(file) as renderer:
        run = reference_run(renderer, spp, store, square=True)
        _grow(run, spp, f"{file.name} reference", progress)
        pilot = run.estimate()
        excess = 2 * pilot.image_variance / error_scale(pilot.image_mean) ** 2 / (tolerance * PRECISION / STUDENT) ** 2
        if np.isfinite(excess).all() and excess.max() > 1:
            more = min(math.ceil(spp * float(excess.max())), MAX_REFERENCE_FACTOR * spp)
            _grow(run, more, f"{file.name} reference, more to decide", progress)
    return run


def _grow(run: Run, spp: int, description: str, progress: Progress) -> None:
    """Draw so many samples per pixel in all, rounded up to whole replicas."""
    replicas = math.ceil(spp / run.spp)
    with progress((replicas - run.replicas) * run.spp, description) as advance:
        run.grow(replicas, advance)


@dataclass(frozen=True)
class _Reference:
    """What strategies are held against: the image with its variance, and its batches as tiles."""

    estimate: Estimate
    tiles: TileSamples


class _Replicas:
    """One strategy's replicas so far: their curves, the merged estimate, the cost."""

    def __init__(self, strategy: Suited, scene: Film, renderer: Renderer, reference: _Reference, spp: int) -> None:
        self.strategy, self.scene, self.renderer, self.reference, self.spp = strategy, scene, renderer, reference, spp
        self.prefixes = prefix_sizes(spp)
        self.replicas = 0
        self.curves: list[list[dict[str, float]]] = []  # per replica that has one, per prefix: metrics by name
        self.total = Accumulator()
        self.tiles = TileAccumulator(tile_size(scene.height, scene.width))
        self.costs: list[tuple[int, Cost]] = []  # samples per pixel of each batch, and what they took

    def add_replica(self, store: Store | None, advance: Advance, *, curve: bool) -> None:
        """Draw one more; with its curve, whose metrics cost as much as some samples, or for the verdict alone."""
        prefix = Accumulator()
        points: list[dict[str, float]] = []

        def measured() -> Iterator[Batch]:  # batches pass through, so that no run is ever held whole
            for batch in batches(self.renderer, self.spp, replica=self.replicas, store=store, advance=advance):
                self.costs.append((batch.samples, batch.cost))
                if curve:
                    prefix.add(batch)
                if curve and prefix.samples in self.prefixes:
                    points.append(metrics.measure(prefix.mean, self.reference.estimate, self.scene.exposure,
                                                  at_prefixes=True))
                yield batch

        # For tiles as well: of uneven sizes, yet more of them and so sharper than if all were made as long as the last.
        independent = self.renderer.traits.independent_batches
        for batch in equal_batches(measured(), self.spp, independent=independent):
            with spent("statistics"):
                self.total.add(batch)
                self.tiles.add(with_luminance(batch.mean), batch.samples)
        self.replicas += 1
        if curve:
            self.curves.append(points)

    @spent("statistics")
    def result(self, plan: Plan, file: SceneFile, expected: tuple[float, ...] = (-0.5,)) -> StrategyResult:
        merged = self.total.estimate()
        strategy, scene, reference = self.strategy, self.scene, self.reference.estimate
        curves = {name: np.array([[point[name] for point in curve] for curve in self.curves])
                  for name in self.curves[0][0]}
        spp = np.array(self.prefixes)
        largest = max(samples for samples, _ in self.costs)
        devices = {cost.device for _, cost in self.costs}
        device = next(iter(devices)) if len(devices) == 1 else ""
        seconds = float(np.median([cost.seconds / samples for samples, cost in self.costs if samples == largest])
                        if device else np.nan)  # never across machines
        return StrategyResult(
            strategy=strategy.name, suits=strategy.suits, warning=strategy.warning,
            measured=measured(file.path.stem, file.given, strategy.name, samples=merged.samples, spp=spp,
                              curves=curves, seconds_per_spp=seconds, rejected=merged.rejected, device=device,
                              scores=metrics.measure(merged.mean, reference, scene.exposure, at_prefixes=False)),
            estimate=merged,
            verdict=judge(merged, reference, tolerance=plan.tolerance.mean, confidence=plan.confidence,
                          fail_level=plan.fail_level),
            tiles=judge_tiles(self.tiles.samples(), self.reference.tiles, plan.tolerance, fail_level=plan.fail_level,
                              pass_level=1 - plan.confidence),
            slope=None if _is_exact(merged) or len(spp) < 3 else fit_slope(spp, curves["rmse"]), expected=expected)


@dataclass(frozen=True)
class _Drawing:
    """Where batches are kept, where they are drawn, and who is told of it."""

    store: Store | None
    executor: Executor | None
    progress: Progress

    def grow(self, run: _Replicas, estimator: Estimator, file: SceneFile, replicas: int, description: str, *,
             curves: bool) -> None:
        """Add so many replicas to the run, with their curves or without."""
        more = range(run.replicas, run.replicas + replicas)
        with self.progress(run.spp * max(replicas, 1), description) as advance:
            if self.executor and self.store:
                draw(tasks_of(estimator, file, more, run.spp), self.executor, self.store, advance,
                     identity=run.renderer.identity)
                advance = _ignore  # what follows reads back
            for _ in more:
                run.add_replica(self.store, advance, curve=curves)


def _ignore(samples: float) -> None:
    """Progress that was told before."""


def _study_estimator(file: SceneFile, film: Film, estimator: Estimator, reference: _Reference, plan: Plan,
                     drawing: _Drawing) -> StrategyResult:
    warning = estimator.check(file)
    strategy = Suited(estimator.name, not warning, warning)
    with estimator.open(file) as renderer:
        run = _Replicas(strategy, film, renderer, reference, plan.spp)
        drawing.grow(run, estimator, file, plan.replicas, f"{file.name} {estimator.name}", curves=True)
        for _ in range(STAGES if strategy.suits else 0):
            needed = replicas_needed(run.total.estimate(), reference.estimate, run.replicas, plan.tolerance.mean)
            if needed <= ENOUGH * run.replicas or run.replicas >= plan.max_replicas:
                break
            drawing.grow(run, estimator, file, min(needed, plan.max_replicas) - run.replicas,
                         f"{file.name} {estimator.name}, more to decide", curves=False)
        sampler = sampler_named(estimator.sampler if isinstance(estimator, Tracer) else DEFAULT)
        return run.result(plan, file, tuple(dict.fromkeys(sampler.slopes)))


def _is_exact(estimate: Estimate) -> bool:
    deviation = math.sqrt(float(np.mean(estimate.variance)) * estimate.samples)
    return deviation <= EXACT * float(np.mean(estimate.mean))


def _provenance(file: SceneFile, film: Film, reading: Scene | None, plan: Plan, reference: Estimate,
                kind: str) -> dict[str, str]:
    return {
        **versions(),
        "scene hash": _hash(file, reading),
        "image size": f"{film.width} x {film.height}",
        **({"path vertices": str(reading.max_depth)} if reading else {}),
        "samples per pixel of each replica": str(plan.spp),
        "replicas (seeds 0, 1, …)": f"{plan.replicas}, up to {plan.max_replicas} where the verdict needs them",
        "reference samples per pixel": str(reference.samples or "exact"),
        **({"reference sampler (Mitsuba)": REFERENCE_SAMPLER} if kind == "Mitsuba" else {}),
    }
