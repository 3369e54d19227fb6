"""Convergence studies: several strategies on one scene against one reference, as curves, verdicts and costs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from harness import metrics
from harness.errors import HarnessError
from harness.gpu.renderer import TracerRenderer
from harness.policy import CONFIDENCE, fail_level, judge, tolerance_for, tolerances
from harness.progress import Advance, Progress, quiet
from harness.results import StrategyResult, StudyResult
from harness.samples.estimate import Accumulator, Batch, Estimate, with_luminance
from harness.samples.store import Store
from harness.scene import Scene, describe
from harness.shader.strategies import check_strategy, suitable_strategies
from harness.stats.bias import error_scale
from harness.stats.convergence import fit_slope
from harness.stats.findings import judge_tiles
from harness.stats.tiles import TileAccumulator, TileSamples, tile_size
from harness.studies.plan import (
    MAX_REFERENCE_FACTOR,
    MAX_REPLICA_FACTOR,
    PRECISION,
    REFERENCE_FACTOR,
    STUDENT,
    Plan,
    prefix_sizes,
    replicas_needed,
)
from harness.work.batches import batches, equal_batches
from harness.work.provenance import versions
from harness.work.run import Run, reference_run, tiles_of

# A strategy whose standard deviation per sample is below this part of the image's mean is exact: what is left is
# rounding, and in a closed scene the one bounce in 10^7 that slips out at an edge.
EXACT = 1e-3


def study(scene: Scene, strategies: Sequence[str] | None = None, *, spp: int = 1024, replicas: int = 8,
          max_replicas: int | None = None, reference_spp: int | None = None, reference: Estimate | None = None,
          tolerance: float | None = None, confidence: float = CONFIDENCE, family: int | None = None,
          store: Store | None = None, progress: Progress = quiet) -> StudyResult:
    """Convergence curves, verdict and cost of each strategy on one scene, against one reference.

    `strategies`: all that suit the scene where None. `spp`: samples per pixel of each replica; where `replicas` are
    too few to decide, more are added, up to `max_replicas` (16 x replicas by default). `reference`: a ready one (closed
    form, file); otherwise Mitsuba renders `reference_spp` samples, 4 x spp by default, and up to 8 times as many where
    its own noise would keep the verdicts from deciding. `tolerance`: of the mean, tiles having theirs in proportion;
    those of `tolerance_for` where None. `family`: how many strategies share the rate of false alarms, those of this
    study where None. A study that was interrupted continues from the store. Raises HarnessError for an unknown
    strategy, counts below their minimum, an image too small for SSIM, and a reference of another size or with pixels
    that are not finite.
    """
    if spp < 1:
        raise HarnessError(f"samples per pixel must be at least 1, found {spp}")
    if replicas < 2:
        raise HarnessError(f"a study needs at least 2 replicas to tell its own uncertainty, found {replicas}")
    names = tuple(dict.fromkeys(strategies)) if strategies else suitable_strategies(scene)
    allowed, reason = tolerance_for(scene) if tolerance is None else (tolerances(tolerance), "")
    suiting = sum(check_strategy(scene, name).suits for name in names)
    plan = Plan(spp, replicas, max_replicas or MAX_REPLICA_FACTOR * replicas, allowed, confidence,
                 fail_level(family or max(suiting, 1)))
    metrics.require_ssim_size(scene.height, scene.width)
    kind = "given" if reference else "Mitsuba"
    if reference is None:
        run = _precise_reference(scene, reference_spp or REFERENCE_FACTOR * spp, plan.tolerance.mean, store, progress)
        reference, tiles = run.estimate(), run.tiles()
    if reference.mean.shape[:2] != (scene.height, scene.width):
        raise HarnessError(f"the reference is {reference.mean.shape[1]} x {reference.mean.shape[0]} pixels, the scene "
                           f"{scene.width} x {scene.height}; render both at the same size")
    if not np.isfinite(reference.mean).all():
        raise HarnessError("the reference holds pixels that are not finite; render it again")
    if kind == "given":
        tiles = tiles_of(reference, tile_size(scene.height, scene.width))
    results = []
    for name in names:
        results.append(_study_strategy(scene, name, _Reference(reference, tiles), plan, store, progress))
    return StudyResult(
        scene=scene.name, description=describe(scene.path) if scene.path else "", scene_hash=scene.content_hash,
        exposure=scene.exposure, reference=reference, reference_kind=kind, strategies=tuple(results),
        notes=(*scene.notes, *filter(None, [reason])), provenance=_provenance(scene, plan, reference))


def _precise_reference(scene: Scene, spp: int, tolerance: float, store: Store | None, progress: Progress) -> Run:
    """Mitsuba's image, with so many samples that it takes at most half of what the verdicts' intervals may be wide.

    As with replicas (Stein 1945), how many is decided from the variance of the first `spp` alone.
    """
    run = reference_run(scene, spp, store)
    _grow(run, spp, f"{scene.name} reference", progress)
    pilot = run.estimate()
    excess = 2 * pilot.image_variance / error_scale(pilot.image_mean) ** 2 / (tolerance * PRECISION / STUDENT) ** 2
    if np.isfinite(excess).all() and excess.max() > 1:
        more = min(math.ceil(spp * float(excess.max())), MAX_REFERENCE_FACTOR * spp)
        _grow(run, more, f"{scene.name} reference, more to decide", progress)
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

    def __init__(self, scene: Scene, renderer: TracerRenderer, reference: _Reference, spp: int) -> None:
        self.scene, self.renderer, self.reference, self.spp = scene, renderer, reference, spp
        self.prefixes = prefix_sizes(spp)
        self.curves: list[list[dict[str, float]]] = []  # per replica, per prefix: metrics by name
        self.total = Accumulator()
        self.tiles = TileAccumulator(tile_size(scene.height, scene.width))
        self.costs: list[tuple[int, float]] = []  # samples per pixel of each batch, CPU seconds for one of them

    def add_replica(self, store: Store | None, advance: Advance) -> None:
        prefix = Accumulator()
        curve: list[dict[str, float]] = []

        def measured() -> Iterator[Batch]:  # batches pass through, so that no run is ever held whole
            for batch in batches(self.renderer, self.spp, replica=len(self.curves), store=store, advance=advance):
                prefix.add(batch)
                self.costs.append((batch.samples, batch.cpu_seconds / batch.samples))
                if prefix.samples in self.prefixes:
                    curve.append(metrics.measure(prefix.mean, self.reference.estimate, self.scene.exposure,
                                                 at_prefixes=True))
                yield batch

        # For tiles as well: of uneven sizes, yet more of them and so sharper than if all were made as long as the last.
        for batch in equal_batches(measured(), self.spp):
            self.total.add(batch)
            self.tiles.add(with_luminance(batch.mean), batch.samples)
        self.curves.append(curve)

    def result(self, plan: Plan) -> StrategyResult:
        merged = self.total.estimate()
        strategy, scene, reference = self.renderer.strategy, self.scene, self.reference.estimate
        curves = {name: np.array([[point[name] for point in curve] for curve in self.curves])
                  for name in self.curves[0][0]}
        spp = np.array(self.prefixes)
        largest = max(samples for samples, _ in self.costs)
        return StrategyResult(
            strategy=strategy.name, suits=strategy.suits, warning=strategy.warning, spp=spp,
            curves=curves, scores=metrics.measure(merged.mean, reference, scene.exposure, at_prefixes=False),
            estimate=merged,
            verdict=judge(merged, reference, tolerance=plan.tolerance.mean, confidence=plan.confidence,
                          fail_level=plan.fail_level),
            tiles=judge_tiles(self.tiles.samples(), self.reference.tiles, plan.tolerance, fail_level=plan.fail_level,
                              pass_level=1 - plan.confidence),
            slope=None if _is_exact(merged) or len(spp) < 3 else fit_slope(spp, curves["rmse"]),
            cpu_seconds_per_spp=float(np.median([cost for samples, cost in self.costs if samples == largest])))


def _study_strategy(scene: Scene, name: str, reference: _Reference, plan: Plan, store: Store | None,
                    progress: Progress) -> StrategyResult:
    renderer = TracerRenderer(scene, name)
    try:
        run = _Replicas(scene, renderer, reference, plan.spp)
        with progress(plan.spp * plan.replicas, f"{scene.name} {name}") as advance:
            for _ in range(plan.replicas):
                run.add_replica(store, advance)
        more = replicas_needed(run.total.estimate(), reference.estimate, plan.replicas, plan.tolerance.mean)
        more = min(more - plan.replicas, plan.max_replicas - plan.replicas) if renderer.strategy.suits else 0
        with progress(plan.spp * max(more, 1), f"{scene.name} {name}, more to decide") as advance:
            for _ in range(more):
                run.add_replica(store, advance)
        return run.result(plan)
    finally:
        renderer.release()


def _is_exact(estimate: Estimate) -> bool:
    deviation = math.sqrt(float(np.mean(estimate.variance)) * estimate.samples)
    return deviation <= EXACT * float(np.mean(estimate.mean))


def _provenance(scene: Scene, plan: Plan, reference: Estimate) -> dict[str, str]:
    return {
        **versions(),
        "scene hash": scene.content_hash,
        "image size": f"{scene.width} x {scene.height}",
        "path vertices": str(scene.max_depth),
        "samples per pixel of each replica": str(plan.spp),
        "replicas (seeds 0, 1, …)": f"{plan.replicas}, up to {plan.max_replicas} where the verdict needs them",
        "reference samples per pixel": str(reference.samples or "exact"),
    }
