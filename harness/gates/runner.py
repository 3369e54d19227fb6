"""Runs one gate: draws samples, looks, and draws more until it is decided or its budget ends."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from harness.estimators.base import Renderer
from harness.gates.budget import factor_needed, tile_scale, too_small
from harness.gates.model import MAX_SIDE, CurvePoint, Gate, GateResult, Look, MitsubaReference
from harness.gates.references import FixedReference, References
from harness.gates.shaders import gate_source
from harness.gpu.renderer import TracerRenderer
from harness.progress import Progress, quiet
from harness.scene import Scene, load_scene
from harness.shader.strategies import check_strategy
from harness.stats.channels import Channel
from harness.stats.needed import times
from harness.stats.tiles import ImageMoments, TileSamples, tile_size
from harness.stats.verdicts import tile_verdict
from harness.work.run import Run

# What renders the test: the tracer, or in tests and for mutants another.
MakeRenderer = Callable[[Gate, Scene], Renderer]


def run_gate(gate: Gate, references: References | None = None, *, progress: Progress = quiet,
             renderer: MakeRenderer | None = None) -> GateResult:
    """Run one gate: look at a quarter, a half and all of its budget, and stop when it is decided.

    `references`: those of a run of several gates, which share them. `renderer`: renders the test instead of the
    tracer with the gate's shader. The test is always rendered, never read from a store, which would not notice a
    change of the host's code. Test and reference grow together. Raises HarnessError for a scene, strategy, shader or
    reference that cannot be used, and for a budget that the variance (not the error) of the first look shows to be too
    small to decide.
    """
    began = time.perf_counter()
    scene = check_gate(gate)
    theirs = (references or References()).of(gate, scene)
    maker = renderer or tracer
    made = maker(gate, scene)
    try:
        ours = Run(made, gate.spp, tile_size(scene.height, scene.width))
        with progress(gate.spp * gate.replicas, gate.name) as advance:
            looks = _look(gate, ours, theirs, advance)
        return _result(gate, scene, looks, ours, theirs, time.perf_counter() - began)
    finally:
        if isinstance(made, TracerRenderer):
            made.release()


def check_gate(gate: Gate) -> Scene:
    """The gate's scene at the gate's size. HarnessError where it cannot be loaded or is too large, or the strategy does
    not suit it."""
    width, height = gate.size or (None, None)
    scene = load_scene(gate.scene, width=width, height=height)
    if max(scene.width, scene.height) > MAX_SIDE:
        raise gate.error(f"the scene's film has {scene.width} x {scene.height} pixels, a gate at most {MAX_SIDE} a "
                         "side; set 'size'")
    strategy = check_strategy(scene, gate.strategy)
    if not strategy.suits:
        raise gate.error(f"strategy '{gate.strategy}' does not suit the scene: {strategy.warning}")
    return scene


def tracer(gate: Gate, scene: Scene) -> TracerRenderer:
    """The tracer with the gate's own shader."""
    return TracerRenderer(scene, gate.strategy, gate_source(gate, scene))


def _look(gate: Gate, ours: Run, theirs: Run | FixedReference, advance: Callable[[float], None]) -> list[Look]:
    done: list[Look] = []
    for number, replicas in enumerate(gate.looks):
        ours.grow(replicas, advance)
        theirs.grow(replicas)
        test, reference = ours.tiles(replicas), theirs.tiles(replicas)
        verdict = gate.sequence.decide(number, test, reference)
        done.append(Look(gate.spp * replicas, int(reference.samples.sum()), verdict))
        if verdict.outcome != "inconclusive":
            break
        if number == 0:
            _require_budget(gate, ImageMoments.of(test), ImageMoments.of(reference))
    return done


def _require_budget(gate: Gate, test: ImageMoments, reference: ImageMoments) -> None:
    if too_small(gate, test, reference):
        factor = gate.looks[0] / gate.replicas * factor_needed(gate.sequence, test, reference)
        also = " (of the reference as well)" if isinstance(gate.reference, MitsubaReference) else ""
        raise gate.error(f"a budget of {gate.replicas} replicas of {gate.spp} samples per pixel is too small to "
                         f"decide; about {times(factor)} the samples would do{also}, or wider tolerances")


def _result(gate: Gate, scene: Scene, looks: list[Look], ours: Run, theirs: Run | FixedReference,
            seconds: float) -> GateResult:
    last = looks[-1].verdict
    outcome, reason = last.outcome, last.reason
    estimate = ours.estimate()
    drawn = estimate.samples * scene.width * scene.height
    if estimate.rejected > gate.not_finite * drawn:
        outcome, reason = "fail", _uncounted(estimate.rejected, drawn)
    elif _is_one_image(ours) and _varies(ours):
        outcome, reason = "fail", ("all replicas are one image, which is not without noise: the seed leaves out "
                                   "`replica`, so its error and its noise cannot be told apart")
    elif outcome != "pass" and _is_one_image(ours):
        reason += "; all batches are one image: without noise, or from a seed without `first_sample` and `replica`"
    elif outcome == "inconclusive":
        reason += f"; the budget of {gate.replicas} x {gate.spp} samples per pixel has ended"
    return GateResult(gate, outcome, reason, tuple(looks), _curve(gate, ours, theirs), estimate, theirs.estimate(),
                      scene.exposure, seconds)


def _uncounted(rejected: int, drawn: int) -> str:
    """What samples that alpha does not count tell: a few were not finite, most or all were never added."""
    counted = f"{rejected} of {drawn} samples were not finite, or not counted in alpha"
    if 2 * rejected > drawn:
        return (f"{counted}; to what pingpong0 holds (nothing at numpass 0) each of samples_per_pass samples must add "
                "its radiance, and 1 to alpha")
    return f"{counted}; look for a division by zero, or a root or power of a negative number"


def _is_one_image(run: Run) -> bool:
    means = run.tiles(run.replicas).means
    return bool((means == means[0]).all())


def _varies(run: Run) -> bool:
    """Do further samples of a replica differ from its first?"""
    first, further = (run.renderer.render_batch(0, start, run.spp).mean for start in (0, run.spp))
    return not np.array_equal(first, further)


def _curve(gate: Gate, ours: Run, theirs: Run | FixedReference) -> tuple[CurvePoint, ...]:
    """Prefixes of 1, 2, 4, … replicas, and all."""
    counts = sorted({*(2**k for k in range(ours.replicas.bit_length())), ours.replicas})
    reference = theirs.tiles(ours.replicas)
    return tuple(_point(gate, ours.tiles(count), reference, gate.spp * count) for count in counts)


def _point(gate: Gate, test: TileSamples, reference: TileSamples, samples: int) -> CurvePoint:
    whole = tile_verdict(test.whole(), reference.whole(), gate.tolerance.mean, pass_level=gate.pass_level)
    error, low, high = (float(values[0, 0, Channel.LUMINANCE]) for values in (whole.error, whole.low, whole.high))
    theirs = reference.moments()
    squares = (test.moments().mean - theirs.mean)**2 - theirs.variance
    square = float((squares / tile_scale(theirs)**2)[..., Channel.LUMINANCE].mean())
    return CurvePoint(samples, error, low, high, float(np.sqrt(max(square, 0.0))))
