"""Convergence studies: strategies and samplers on one scene against one reference, as curves, verdicts and costs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness import metrics
from harness.errors import HarnessError, SceneError
from harness.estimators.base import Estimator
from harness.estimators.mitsuba import Mitsuba
from harness.estimators.tracer import Tracer
from harness.policy import CONFIDENCE, TOLERANCE, fail_level, tolerance_for, tolerances
from harness.progress import Progress, quiet
from harness.results import StrategyResult, StudyResult
from harness.samples.estimate import Estimate
from harness.samples.store import Store
from harness.scene import Film, Scene, SceneFile, describe, file_of, load, present
from harness.scene.strategies import Suited, suitable_strategies
from harness.shader.samplers import DEFAULT, sampler_named
from harness.stats.bias import error_scale
from harness.stats.tiles import tile_size
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
    replicas_needed,
)
from harness.studies.remaining import REFERENCE, Schedule
from harness.studies.replicas import Reference, Replicas
from harness.work.executors import Executor
from harness.work.provenance import versions
from harness.work.run import Run, reference_run, tiles_of
from harness.work.tasks import draw, tasks_of

# Mitsuba's best sampler: its replicas of 16 samples have 1.8 (course_scene) to 6.3 times (textures) less variance than
# the independent one's, and they stay independent of each other, which is all that variances and verdicts rest on.
REFERENCE_SAMPLER = "multijitter"


def study(scene: Scene | SceneFile, strategies: Sequence[str | Estimator] | None = None, *,
          samplers: Sequence[str] = (DEFAULT,), spp: int = 1024, replicas: int = 8,
          max_replicas: int | None = None, reference_spp: int | None = None, reference: Estimate | None = None,
          tolerance: float | None = None, confidence: float = CONFIDENCE, family: int | None = None,
          error: float | None = None, store: Store | None = None, executor: Executor | None = None,
          progress: Progress = quiet, schedule: Schedule | None = None) -> StudyResult:
    """Convergence curves, verdict and cost of each strategy on one scene, against one reference.

    `strategies`: of the tracer by name, or any other estimators; all of the tracer's that suit the scene where None.
    `samplers`: of the tracer by name; each strategy that is named is studied with each of them.
    `spp`: samples per pixel of each replica; where `replicas` are too few to decide, more are added, up to
    `max_replicas` (16 x replicas by default), without curves. `reference`: a ready one (closed form, file); otherwise
    Mitsuba renders `reference_spp` samples, 4 x spp by default, and up to 16 times as many where its own noise would
    keep the verdicts from deciding; in replicas whose samples its best sampler spreads evenly. `tolerance`: of the
    mean, tiles having theirs in proportion; those of `tolerance_for` where None. `family`: how many strategies share
    the rate of false alarms, those of this study where None. `error`: the RMSE, relative to the reference's mean
    luminance, at which costs are told. A study that was interrupted continues from the store. `executor`: where batches
    are drawn, here where None; it needs a `store`, through which they come back. `schedule` is told how far it is.
    Raises HarnessError for an unknown strategy, counts below their minimum, an image too small for SSIM, and a
    reference of another size or with pixels that are not finite.
    """
    if spp < 1:
        raise HarnessError(f"samples per pixel must be at least 1, found {spp}")
    if executor and not store:
        raise HarnessError("an executor hands its batches over through a store; give the study one")
    if replicas < 2:
        raise HarnessError(f"a study needs at least 2 replicas to tell its own uncertainty, found {replicas}")
    file = scene if isinstance(scene, SceneFile) else file_of(scene)
    estimators = estimators_of(file, strategies, samplers)
    film, reading = file.film, _reading(file, estimators)
    allowed, reason = _tolerance(reading, tolerance)
    suiting = sum(not estimator.check(file) for estimator in estimators)
    plan = Plan(spp, replicas, max_replicas or MAX_REPLICA_FACTOR * replicas, allowed, confidence,
                 fail_level(family or max(suiting, 1)))
    metrics.require_ssim_size(film.height, film.width)
    drawing = _Drawing(store, executor, progress, schedule or Schedule())
    expect(drawing.schedule, file, film, estimators, plan.spp, replicas,
           0 if reference else reference_spp or REFERENCE_FACTOR * spp)
    kind = "given" if reference else "Mitsuba"
    looked = None
    if reference is None:
        run, looked = _precise_reference(file, reference_spp or REFERENCE_FACTOR * spp, plan.tolerance.mean, drawing)
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
        results.append(_study_estimator(file, film, estimator, Reference(reference, tiles, looked), plan, drawing))
    return StudyResult(
        scene=file.name, description=describe(file.path), scene_hash=_hash(file, reading), exposure=film.exposure,
        reference=reference, reference_kind=kind, strategies=tuple(results),
        notes=(*(present(file).notes if reading else ()), *filter(None, [reason])),
        provenance=_provenance(file, film, reading, plan, reference, kind), error=error)


def expect(schedule: Schedule, file: SceneFile, film: Film, estimators: Sequence[Estimator], spp: int, replicas: int,
           reference_spp: int) -> None:
    """Tell a schedule what a study begins with; `reference_spp`: 0 where the reference is there."""
    pixels = film.width * film.height
    if reference_spp:
        schedule.expect(file.name, REFERENCE, reference_spp * pixels)
    for estimator in estimators:
        schedule.expect(file.name, estimator.name, spp * replicas * pixels)


def estimators_of(file: SceneFile, named: Sequence[str | Estimator] | None,
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


def _precise_reference(file: SceneFile, spp: int, tolerance: float, drawing: _Drawing) -> tuple[Run, int | None]:
    """Mitsuba's image, with so many samples that it takes at most half of what the verdicts' intervals may be wide.

    As with replicas (Stein 1945), how many is decided from the variance of the first `spp` alone; beside it stands of
    how many batches that was, None where they were enough.
    """
    looked = None
    with Mitsuba(sampler=REFERENCE_SAMPLER).open(file) as renderer:
        run = reference_run(renderer, spp, drawing.store, square=True)
        film = file.film
        _grow(run, spp, file, film, "reference", drawing)
        pilot = run.estimate()
        excess = 2 * pilot.image_variance / error_scale(pilot.image_mean) ** 2 / (tolerance * PRECISION / STUDENT) ** 2
        if np.isfinite(excess).all() and excess.max() > 1:
            looked = pilot.batches
            more = min(math.ceil(spp * float(excess.max())), MAX_REFERENCE_FACTOR * spp)
            drawing.schedule.settle(file.name, REFERENCE, more * film.width * film.height)
            _grow(run, more, file, film, "reference, more to decide", drawing)
        drawing.schedule.end(file.name, REFERENCE)
    return run, looked


def _grow(run: Run, spp: int, file: SceneFile, film: Film, description: str, drawing: _Drawing) -> None:
    """Draw so many samples per pixel in all, rounded up to whole replicas."""
    replicas = math.ceil(spp / run.spp)
    samples, pixels = (replicas - run.replicas) * run.spp, film.width * film.height
    with (drawing.progress(samples, f"{file.name} {description}") as show,
          drawing.schedule.working(file.name, REFERENCE, samples * pixels) as note):

        def advance(done: float) -> None:
            show(done)
            note(done * pixels)

        run.grow(replicas, advance)


@dataclass(frozen=True)
class _Drawing:
    """Where batches are kept, where they are drawn, and who is told of it."""

    store: Store | None
    executor: Executor | None
    progress: Progress
    schedule: Schedule

    def grow(self, run: Replicas, estimator: Estimator, file: SceneFile, replicas: int, description: str, *,
             curves: bool) -> None:
        """Add so many replicas to the run, with their curves or without."""
        more = run.numbers(replicas)
        work = run.samples(curve=curves) * replicas
        pixels = run.scene.width * run.scene.height
        with (self.progress(max(work, 1), description) as show,
              self.schedule.working(file.name, estimator.name, work * pixels) as note):

            def advance(samples: float) -> None:
                show(samples)
                note(samples * pixels)

            # Whole runs are drawn here: a program runs as it likes, and images are there.
            if self.executor and self.store and not run.whole_runs:
                tasks = tasks_of(estimator, file, more, run.spp, prefixes=curves, repeats=run.renderer.traits.repeats)
                draw(tasks, self.executor, self.store, advance, identity=run.renderer.identity)
                advance = _ignore  # what follows reads back
            for _ in more:
                run.add_replica(self.store, advance, curve=curves)


def _ignore(samples: float) -> None:
    """Progress that was told before."""


def _study_estimator(file: SceneFile, film: Film, estimator: Estimator, reference: Reference, plan: Plan,
                     drawing: _Drawing) -> StrategyResult:
    warning = estimator.check(file)
    strategy = Suited(estimator.name, not warning, warning)
    with estimator.open(file) as renderer:
        run = Replicas(strategy, film, renderer, reference, plan.spp, downwards=isinstance(estimator, Mitsuba))
        replicas = run.allowed(plan.replicas)
        drawing.grow(run, estimator, file, replicas, f"{file.name} {estimator.name}", curves=True)
        most = run.allowed(plan.max_replicas)
        for _ in range(STAGES if strategy.suits else 0):
            needed = replicas_needed(run.total.estimate(), reference.estimate, run.replicas, plan.tolerance.mean)
            if needed <= ENOUGH * run.replicas or run.replicas >= most:
                break
            run.looked = run.looked or run.total.batches
            drawing.grow(run, estimator, file, min(needed, most) - run.replicas,
                         f"{file.name} {estimator.name}, more to decide", curves=False)
        drawing.schedule.end(file.name, estimator.name)
        sampler = sampler_named(estimator.sampler if isinstance(estimator, Tracer) else DEFAULT)
        return run.result(plan, file, tuple(dict.fromkeys(sampler.slopes)))


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
