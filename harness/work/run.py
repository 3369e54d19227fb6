"""A run: the replicas of one renderer as far as they were drawn, as an image and as tiles."""

from __future__ import annotations

import numpy as np

from harness.estimators.base import Renderer, scene_name
from harness.progress import Advance
from harness.samples.estimate import Accumulator, Batch, Estimate, with_luminance
from harness.samples.keys import digest
from harness.samples.store import LONGEST_BATCH, Store
from harness.stats.tiles import TileAccumulator, TileSamples, tile_size, tile_sums

# Batches that a reference is drawn in at the least, where it has so many samples: see `stats.tiles.TileSamples`.
REFERENCE_BATCHES = 32
# Of short ones whose samplers spread samples over a square half as many are enough: as many samples of spheres by
# multijitter in replicas of 16 have 1.6 times less variance a pixel than in replicas of 4, and 1.8 in the image's mean.
SQUARE = 16


class Run:
    """The replicas 0, 1, … of one renderer as far as they were drawn: one batch of `spp` samples per pixel each."""

    def __init__(self, renderer: Renderer, spp: int, store: Store | None = None) -> None:
        self.renderer, self.spp, self.store = renderer, spp, store
        self.replicas = 0
        self.twins: tuple[int, int] | None = None  # the first two replicas with the same pixels
        self.images = 0  # how many replicas differ from all before them
        self._identity = dict(renderer.identity)
        self._seen: dict[str, int] = {}
        self._image = Accumulator()
        self._tiles: TileAccumulator | None = None

    def grow(self, replicas: int, advance: Advance = lambda n: None) -> None:
        """Draw, or read from the store, up to so many replicas; `advance` is told the samples per pixel of each."""
        while self.replicas < replicas:
            batch = self._batch(self.replicas)
            self._image.add(batch)
            self._note(batch)
            if self._tiles is None:
                self._tiles = TileAccumulator(tile_size(*batch.mean.shape[:2]))
            # Of the largest in each channel, the luminance is no less than that of any one sample.
            largest = None if batch.largest is None else with_luminance(batch.largest)
            self._tiles.add(with_luminance(batch.mean), batch.samples, largest)
            self.replicas += 1
            advance(self.spp)

    def tiles(self, replicas: int | None = None) -> TileSamples:
        """The first so many replicas, or all, reduced to tiles; no more than were drawn. ValueError where none was."""
        if self._tiles is None:
            raise ValueError("no replica was drawn")
        return self._tiles.samples().first(self.replicas if replicas is None else replicas)

    def estimate(self) -> Estimate:
        """All that was drawn."""
        return self._image.estimate()

    def _note(self, batch: Batch) -> None:
        """Any two replicas may be one: a seed from the pass alone spares the first, whose passes are cut otherwise."""
        first = self._seen.setdefault(digest(batch.mean), self.replicas)
        self.images = len(self._seen)
        if first < self.replicas and self.twins is None:
            self.twins = first, self.replicas

    def _batch(self, replica: int) -> Batch:
        def render() -> Batch:
            return self.renderer.render_batch(replica, 0, self.spp)

        return self.store.get_or_render(self._identity, replica, 0, self.spp, render,
                                        scene=scene_name(self.renderer)) if self.store else render()


class FixedRun:
    """A run of a renderer whose answer is there from the beginning: a closed form, or a stored image."""

    def __init__(self, renderer: Renderer, estimate: Estimate) -> None:
        self.renderer, self.replicas, self.spp = renderer, 0, 1
        self._estimate = estimate
        self._tiles = tiles_of(estimate, tile_size(*estimate.mean.shape[:2]))

    def grow(self, replicas: int, advance: Advance = lambda n: None) -> None:
        """Nothing to draw."""
        self.replicas = max(self.replicas, replicas)

    def tiles(self, replicas: int | None = None) -> TileSamples:
        """The same for any number of replicas."""
        return self._tiles

    def estimate(self) -> Estimate:
        """The image and its variance."""
        return self._estimate


def run_of(renderer: Renderer, spp: int, store: Store | None = None) -> Run | FixedRun:
    """The run of a renderer, in replicas of `spp` samples per pixel unless the renderer fixes their number."""
    fixed = renderer.traits.fixed
    return Run(renderer, renderer.traits.spp or spp, store) if fixed is None else FixedRun(renderer, fixed)


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


def reference_run(renderer: Renderer, spp: int, store: Store | None = None, *, square: bool = False) -> Run:
    """A reference to be drawn in replicas: so long that `REFERENCE_BATCHES` of them make `spp`.

    Lengths are powers of two up to the longest batch, so that references of unequal length can share what is stored;
    where they are to be `square`, as samplers want them that spread samples over a square, powers of four, and of 256
    samples and more no shorter than `SQUARE`.
    """
    length = max(1, spp // REFERENCE_BATCHES)
    if square and spp >= SQUARE * SQUARE:
        length = max(length, SQUARE)
    power = min(length, LONGEST_BATCH).bit_length() - 1
    return Run(renderer, 2 ** (power - power % 2 if square else power), store)
