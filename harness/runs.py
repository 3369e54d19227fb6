"""Renders through the store: batches, estimates and references of any renderer, and the verdict on two of them."""

from __future__ import annotations

import math
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from importlib import metadata
from typing import Protocol

import numpy as np

from harness.errors import HarnessError
from harness.estimate import Accumulator, Batch, Estimate
from harness.reference.renderer import ReferenceRenderer
from harness.scene import Scene
from harness.stats.bias import MeanErrorVerdict, mean_error_verdict
from harness.store import Store, schedule
from harness.tracer.context import describe_gl
from harness.tracer.renderer import TracerRenderer

# The bias that an equivalence verdict tolerates, and its confidence, unless the caller says otherwise.
TOLERANCE = 0.002
CONFIDENCE = 0.95
# The same where the reference shows a mesh in place of a displaced sphere (harness/reference/displaced.py).
MESH_TOLERANCE = 0.005
# Equal batches that a run is cut into at the least, for its variance; see `equal_batches`.
MIN_EQUAL_BATCHES = 8

Advance = Callable[[float], None]
Progress = Callable[[float | None, str], AbstractContextManager[Advance]]


class Renderer(Protocol):
    """What renders batches: the tracer, the reference, or anybody's black box."""

    @property
    def identity(self) -> Mapping[str, str]:
        """All that a batch depends on besides replica and sample range."""
        ...

    def render_batch(self, replica: int, start: int, count: int, advance: Advance | None = None) -> Batch:
        """Samples start … start+count-1 of one replica."""
        ...


@contextmanager
def quiet(total: float | None, description: str) -> Iterator[Advance]:
    """The progress display that shows nothing."""
    yield lambda n: None


def batches(renderer: Renderer, samples: int, *, replica: int = 0, store: Store | None = None,
            advance: Advance = lambda n: None) -> Iterator[Batch]:
    """The first `samples` samples per pixel of one replica, batch by batch in the store's fixed schedule.

    What the store already holds is read, the rest rendered and kept. HarnessError for fewer than one sample.
    """
    if samples < 1:
        raise HarnessError(f"samples per pixel must be at least 1, found {samples}")
    identity = dict(renderer.identity)
    for start, count in schedule(samples):
        def render(start: int = start, count: int = count) -> Batch:
            return renderer.render_batch(replica, start, count)

        yield store.get_or_render(identity, replica, start, count, render) if store else render()
        advance(count)


def equal_batches(run: Iterable[Batch], samples: int) -> Iterator[Batch]:
    """The small batches that a run begins with, merged until all are about equal and there are enough of them.

    The variance by batch means is unbiased for unequal batches too, but the smallest batches of a heavy-tailed
    estimator are the noisiest witnesses of its variance, and merging them loses no more than a few degrees of freedom.
    """
    size = max(1, samples // MIN_EQUAL_BATCHES)
    pending: list[Batch] = []
    for batch in run:
        pending.append(batch)
        if sum(b.samples for b in pending) >= min(size, schedule(samples)[-1][1]):
            yield _merged(pending)
            pending = []
    if pending:
        yield _merged(pending)


def render_estimate(renderer: Renderer, samples: int, *, replica: int = 0, store: Store | None = None,
             advance: Advance = lambda n: None) -> Estimate:
    """Mean and variance of `samples` samples per pixel of one replica."""
    accumulator = Accumulator()
    for batch in equal_batches(batches(renderer, samples, replica=replica, store=store, advance=advance), samples):
        accumulator.add(batch)
    return accumulator.estimate()


def render(scene: Scene, strategy: str = "mixture", spp: int = 256, *, replica: int = 0, store: Store | None = None,
           progress: Progress = quiet) -> Estimate:
    """The tracer's image of the scene with `spp` samples per pixel. HarnessError for an unknown strategy."""
    renderer = TracerRenderer(scene, strategy)
    try:
        with progress(spp, f"{scene.name} {strategy}") as advance:
            return render_estimate(renderer, spp, replica=replica, store=store, advance=advance)
    finally:
        renderer.release()


def render_reference(scene: Scene, spp: int, *, store: Store | None = None, progress: Progress = quiet) -> Estimate:
    """Mitsuba's image of the scene with `spp` samples per pixel."""
    renderer = ReferenceRenderer(scene)
    with progress(spp, f"{scene.name} reference") as advance:
        return render_estimate(renderer, spp, store=store, advance=advance)


def judge(test: Estimate, reference: Estimate, *, tolerance: float = TOLERANCE,
          confidence: float = CONFIDENCE) -> MeanErrorVerdict:
    """Is the test's image mean equivalent to the reference's, per channel and in luminance?"""
    return mean_error_verdict(
        test.image_mean, test.image_variance, _degrees_of_freedom(test),
        reference.image_mean, reference.image_variance, _degrees_of_freedom(reference),
        tolerance=tolerance, confidence=confidence)


def tolerance_for(scene: Scene) -> tuple[float, str]:
    """The bias that a verdict on this scene tolerates, and a sentence that says why it is not the usual one."""
    if any(shape.displacement for shape in scene.shapes):
        return MESH_TOLERANCE, (f"the tolerance is {MESH_TOLERANCE:.1%} instead of {TOLERANCE:.1%}: the reference "
                                "shows meshes in place of the displaced spheres")
    return TOLERANCE, ""


def versions() -> dict[str, str]:
    """Versions of all that numbers depend on: packages, Python, the GL driver."""
    packages = ("glsl-validation-harness", "mitsuba", "drjit", "moderngl", "numpy", "scikit-image",
                "flip-evaluator")
    return {
        **{name: metadata.version(name) for name in packages},
        "python": platform.python_version(),
        **describe_gl(),
    }


def _degrees_of_freedom(estimate: Estimate) -> float:
    return math.inf if estimate.batches == 0 else estimate.batches - 1


def _merged(parts: Sequence[Batch]) -> Batch:
    if len(parts) == 1:
        return parts[0]
    samples = sum(part.samples for part in parts)
    total = sum(part.mean.astype(np.float64) * part.samples for part in parts)
    return Batch(np.asarray(total / samples), samples, sum(part.rejected for part in parts),
                 sum(part.cpu_seconds for part in parts))
