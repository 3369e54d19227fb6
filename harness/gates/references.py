"""What gates are held against: Mitsuba's image as it grows, a file, or a closed form; shared by gates of one scene."""

from __future__ import annotations

import numpy as np

from harness.errors import HarnessError
from harness.estimate import Accumulator, Batch, Estimate, with_luminance
from harness.exr import read_estimate
from harness.gates.model import FileReference, Gate, MitsubaReference, ValueReference
from harness.reference.renderer import ReferenceRenderer
from harness.runs import Advance, Renderer
from harness.scene import Scene
from harness.stats.tiles import TileAccumulator, TileSamples, tile_size, tile_sums
from harness.store import Store


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

    def tiles(self, replicas: int) -> TileSamples:
        """The first so many replicas, reduced to tiles; no more than were drawn."""
        return self._tiles.samples().first(replicas)

    def estimate(self) -> Estimate:
        """All that was drawn."""
        return self._image.estimate()

    def _batch(self, replica: int) -> Batch:
        def render() -> Batch:
            return self.renderer.render_batch(replica, 0, self.spp)

        return self.store.get_or_render(self._identity, replica, 0, self.spp, render) if self.store else render()


class FixedReference:
    """A reference that is all there from the beginning: a file or a closed form."""

    def __init__(self, estimate: Estimate, tiles: TileSamples) -> None:
        self._estimate, self._tiles = estimate, tiles

    def grow(self, replicas: int, advance: Advance = lambda n: None) -> None:
        """Nothing to draw."""

    def tiles(self, replicas: int) -> TileSamples:
        """The same for any number of replicas."""
        return self._tiles

    def estimate(self) -> Estimate:
        """The image and its variance."""
        return self._estimate


class References:
    """The references of a run of several gates: the same scene at the same size is rendered once.

    Holds Mitsuba's scenes, which take about a second each to compile. `store`: where Mitsuba's batches are kept, and
    looked for, between runs.
    """

    def __init__(self, store: Store | None = None) -> None:
        self._store = store
        self._runs: dict[tuple[str, int], Run] = {}

    def of(self, gate: Gate, scene: Scene) -> Run | FixedReference:
        """The reference of a gate, its scene being at the gate's size. HarnessError for a file that does not fit."""
        tile = tile_size(scene.height, scene.width)
        match gate.reference:
            case MitsubaReference(spp):
                key = scene.content_hash, spp
                if key not in self._runs:
                    self._runs[key] = Run(ReferenceRenderer(scene), spp, tile, self._store)
                return self._runs[key]
            case ValueReference(rgb):
                image = np.broadcast_to(np.array(rgb), (scene.height, scene.width, 3)).copy()
                return FixedReference(Estimate.exact(image), TileSamples.exact(with_luminance(image), tile))
            case FileReference():
                estimate = _read(gate, gate.reference, scene)
                return FixedReference(estimate, tiles_of(estimate, tile))


def tiles_of(estimate: Estimate, tile: int) -> TileSamples:
    """Batches as they might have been of which a stored estimate is the mean.

    The file has each pixel's mean and variance but not the batches. Pixels are independent (box filter, independent
    sampler), so the variances of tiles are known; as many normal batches as there were are drawn around the mean, and
    scaled such that each tile's own moments are just these. Their skewness is lost.
    """
    image = with_luminance(estimate.mean)
    if estimate.batches == 0:
        return TileSamples.exact(image, tile)
    variance = np.concatenate([estimate.variance, estimate.luminance_variance[..., None]], axis=-1)
    pixels = tile_sums(np.ones((*image.shape[:2], 1)), tile)
    sigma = np.sqrt(tile_sums(variance, tile)) / pixels
    noise = np.random.default_rng(estimate.samples).standard_normal((estimate.batches, *sigma.shape[:2], 1))
    noise -= noise.mean(axis=0)
    noise /= np.sqrt((noise**2).sum(axis=0) / (estimate.batches * (estimate.batches - 1)))
    return TileSamples(tile_sums(image, tile) / pixels + sigma * noise,
                       np.full(estimate.batches, estimate.samples / estimate.batches), tile, *image.shape[:2])


def _read(gate: Gate, reference: FileReference, scene: Scene) -> Estimate:
    estimate, _ = read_estimate(reference.path)
    height, width = estimate.mean.shape[:2]
    if (height, width) != (scene.height, scene.width):
        raise gate.error(f"the reference {reference.path.name} is {width} x {height} pixels, the gate {scene.width} x "
                         f"{scene.height}; set 'size'")
    if estimate.batches and np.isnan(estimate.variance).any():
        raise gate.error(f"the reference {reference.path.name} carries no variance, so nothing can be decided; write "
                         "it with `harness reference` or harness.write_estimate")
    if not np.isfinite(estimate.mean).all():
        raise HarnessError(f"{reference.path}: holds pixels that are not finite; render it again")
    return estimate
