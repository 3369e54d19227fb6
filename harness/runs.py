"""Renders through the store: batches, estimates and references of any renderer, and the verdict on two of them."""

from __future__ import annotations

import dataclasses
import math
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from importlib import metadata
from typing import Protocol

import numpy as np

from harness.errors import HarnessError
from harness.estimate import Accumulator, Batch, Estimate, with_luminance
from harness.reference.renderer import ReferenceRenderer
from harness.scene import Scene
from harness.stats.bias import MeanErrorVerdict, mean_error_verdict
from harness.stats.levels import family_level
from harness.stats.tiles import TileAccumulator, TileSamples, tile_size, tile_sums
from harness.stats.verdicts import TESTS, Tolerance
from harness.store import LONGEST_BATCH, Store, schedule
from harness.tracer.context import describe_gl
from harness.tracer.renderer import TracerRenderer

# The bias that an equivalence verdict tolerates, and its confidence, unless the caller says otherwise.
TOLERANCE = 0.002
CONFIDENCE = 0.95
# The same of the mean where the reference shows a mesh in place of a displaced sphere (harness/reference/displaced.py).
# Tiles are not given more: with 16,384 samples per pixel a side, those of `displaced` and `displaced_spheres` (of 1/21
# and 1/19 of the image's width) are nowhere off by more than 0.3 %, which is what noise makes of them (|z| <= 3.1).
MESH_TOLERANCE = 0.005
# The probability with which all verdicts of one study, comparison or report together fail good renders, at the most.
FALSE_ALARMS = 0.01
# Batches that a reference is drawn in at the least, where it has so many samples: see `stats.tiles.TileSamples`.
REFERENCE_BATCHES = 32
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


class Run:
    """The replicas 0, 1, … of one renderer as far as they were drawn: one batch of `spp` samples per pixel each."""

    def __init__(self, renderer: Renderer, spp: int, tile: int, store: Store | None = None) -> None:
        self.renderer, self.spp, self.store = renderer, spp, store
        self.replicas = 0
        self._identity = dict(renderer.identity)
        self._image = Accumulator()
        self._tiles = TileAccumulator(tile)

    def grow(self, replicas: int, advance: Advance = lambda n: None) -> None:
        """Draw, or read from the store, up to so many replicas; `advance` is told the samples per pixel of each."""
        while self.replicas < replicas:
            batch = self._batch(self.replicas)
            self._image.add(batch)
            self._tiles.add(with_luminance(batch.mean), batch.samples)
            self.replicas += 1
            advance(self.spp)

    def tiles(self, replicas: int | None = None) -> TileSamples:
        """The first so many replicas, or all, reduced to tiles; no more than were drawn."""
        return self._tiles.samples().first(self.replicas if replicas is None else replicas)

    def estimate(self) -> Estimate:
        """All that was drawn."""
        return self._image.estimate()

    def _batch(self, replica: int) -> Batch:
        def render() -> Batch:
            return self.renderer.render_batch(replica, 0, self.spp)

        return self.store.get_or_render(self._identity, replica, 0, self.spp, render) if self.store else render()


def tiles_of(estimate: Estimate, tile: int) -> TileSamples:
    """Batches as they might have been of which a stored estimate is the mean.

    The file has each pixel's mean and variance but not the batches. Pixels are independent (box filter, independent
    sampler), so the variances of tiles are known; as many normal batches as there were are drawn around the mean, and
    scaled such that each tile's own moments are just these. Their skewness is lost. Of an unknown variance there is
    one batch, which knows no variance either.
    """
    image = with_luminance(estimate.mean)
    if estimate.batches == 0:
        return TileSamples.exact(image, tile)
    pixels = tile_sums(np.ones((*image.shape[:2], 1)), tile)
    means = tile_sums(image, tile) / pixels
    if estimate.batches < 2 or np.isnan(estimate.variance).any():
        return TileSamples(means[None], np.array([max(estimate.samples, 1.0)]), tile, *image.shape[:2])
    variance = np.concatenate([estimate.variance, estimate.luminance_variance[..., None]], axis=-1)
    sigma = np.sqrt(tile_sums(variance, tile)) / pixels
    noise = np.random.default_rng(estimate.samples).standard_normal((estimate.batches, *sigma.shape[:2], 1))
    noise -= noise.mean(axis=0)
    noise /= np.sqrt((noise**2).sum(axis=0) / (estimate.batches * (estimate.batches - 1)))
    return TileSamples(means + sigma * noise, np.full(estimate.batches, estimate.samples / estimate.batches), tile,
                       *image.shape[:2])


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


def reference_run(scene: Scene, spp: int, store: Store | None = None) -> Run:
    """Mitsuba's image of the scene, to be drawn in replicas: so long that `REFERENCE_BATCHES` of them make `spp`.

    Lengths are powers of two up to the longest batch, so that references of unequal length can share what is stored.
    """
    length = 2 ** max(0, (spp // REFERENCE_BATCHES).bit_length() - 1)
    return Run(ReferenceRenderer(scene), min(length, LONGEST_BATCH), tile_size(scene.height, scene.width), store)


def judge(test: Estimate, reference: Estimate, *, tolerance: float = TOLERANCE, confidence: float = CONFIDENCE,
          fail_level: float | None = None) -> MeanErrorVerdict:
    """Is the test's image mean equivalent to the reference's, per channel and in luminance?"""
    return mean_error_verdict(
        test.image_mean, test.image_variance, _degrees_of_freedom(test),
        reference.image_mean, reference.image_variance, _degrees_of_freedom(reference),
        tolerance=tolerance, confidence=confidence, fail_level=fail_level)


def fail_level(family: int) -> float:
    """The level at which each test of a strategy (image, larger tiles, smaller tiles) fails, so many strategies
    sharing `FALSE_ALARMS`."""
    return family_level(FALSE_ALARMS, TESTS * family)


def tolerances(mean: float) -> Tolerance:
    """The tolerances of the tiles that go with one of the mean: larger by what `Tolerance`'s own are, in balance."""
    usual = Tolerance()
    return Tolerance(mean, mean / usual.mean * usual.coarse, mean / usual.mean * usual.fine)


def tolerance_for(scene: Scene) -> tuple[Tolerance, str]:
    """The bias that verdicts on this scene tolerate, and a sentence that says why it is not the usual one."""
    usual = tolerances(TOLERANCE)
    if any(shape.displacement for shape in scene.shapes):
        return dataclasses.replace(usual, mean=MESH_TOLERANCE), (
            f"the tolerance of the mean is {MESH_TOLERANCE:.1%} instead of {TOLERANCE:.1%}: the reference shows meshes "
            "in place of the displaced spheres. Those of tiles are as usual, since meshes are measured to stay far "
            "within them")
    return usual, ""


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
