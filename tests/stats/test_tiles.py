"""Tiles: sums, moments by batch means, and sizes of which a patch always holds one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from harness.stats.tiles import (
    COARSER,
    MAX_BATCHES,
    PATCH,
    TileAccumulator,
    TileSamples,
    tile_means,
    tile_size,
    tile_sums,
)


def filled(images: np.ndarray, samples: list[int], tile: int = 4) -> TileSamples:
    """Batches with these images, (B, H, W, C), as tiles."""
    accumulator = TileAccumulator(tile)
    for image, count in zip(images, samples, strict=True):
        accumulator.add(image, count)
    return accumulator.samples()


def test_tiles_at_the_edges_may_be_smaller() -> None:
    image = np.arange(5 * 7.0).reshape(5, 7)
    sums = tile_sums(image, 4)
    expected = [[image[:4, :4].sum(), image[:4, 4:].sum()], [image[4:, :4].sum(), image[4:, 4:].sum()]]
    np.testing.assert_array_equal(sums, expected)
    np.testing.assert_allclose(tile_means(image[..., None], 4)[..., 0], sums / [[16, 12], [4, 3]])


@pytest.mark.parametrize(("height", "width"), [(64, 64), (60, 60), (96, 128), (120, 160), (72, 96), (256, 256),
                                               (1024, 1024), (20, 300), (9, 9), (1, 1)])
def test_every_square_of_a_hundredth_of_the_image_holds_a_whole_small_tile(height: int, width: int) -> None:
    """At any place, from the first to the last pixel at which such a square can begin."""
    tile, side = tile_size(height, width), max(1, int(np.sqrt(PATCH * height * width)))

    def always_held(length: int) -> bool:
        return all(-(-first // length) * length + length <= first + side for first in range(length))

    assert always_held(tile)
    assert not always_held(tile + 1)


class TestMoments:
    """Against the textbook, and on average the truth."""

    def test_are_those_of_the_batches(self, rng: np.random.Generator) -> None:
        """Equal batches: scipy's unbiased second and third k-statistics, over B and B²."""
        images = rng.gamma(1.0, 1.0, (7, 8, 12, 4))
        moments = filled(images, [16] * 7).moments()
        blocks = images.reshape(7, 2, 4, 3, 4, 4).mean((2, 4))
        np.testing.assert_allclose(moments.mean, blocks.mean(0))
        np.testing.assert_allclose(moments.variance, blocks.var(0, ddof=1) / 7)
        third = np.apply_along_axis(lambda values: stats.kstat(values, 3), 0, blocks) / 7**2
        np.testing.assert_allclose(moments.third, third)
        assert moments.dof == 6

    def test_have_no_bias_when_batches_differ_in_size(self, rng: np.random.Generator) -> None:
        """A sum of n exponential samples has mean, variance and third moment n, n, 2n."""
        counts = np.array([1, 1, 2, 4, 8, 5])
        trials = 60000
        means = rng.gamma(counts[:, None], 1.0, (6, trials)) / counts[:, None]
        samples = TileSamples(means[:, :, None, None], counts, 1, trials, 1).moments()
        total = counts.sum()
        for found, expected in ((samples.mean, 1.0), (samples.variance, 1 / total), (samples.third, 2 / total**2)):
            spread = found.std() / np.sqrt(trials)
            assert abs(found.mean() - expected) < 4 * spread

    def test_of_an_exact_image_vanish(self) -> None:
        moments = TileSamples.exact(np.ones((8, 8, 4)), 4).moments()
        assert not moments.variance.any() and not moments.third.any() and moments.dof == np.inf

    def test_of_too_few_batches_are_unknown(self) -> None:
        """One batch has no variance, two have no skewness."""
        assert np.isnan(filled(np.ones((1, 8, 8, 4)), [4]).moments().variance).all()
        two = filled(np.random.default_rng(1).uniform(size=(2, 8, 8, 4)), [4, 4]).moments()
        assert (two.variance > 0).all() and not two.third.any()


@pytest.mark.parametrize(("height", "width"), [(24, 24), (25, 31)])
def test_larger_tiles_are_those_of_the_pixels(rng: np.random.Generator, height: int, width: int) -> None:
    """Also at ragged edges, and up to the whole image."""
    images = rng.uniform(size=(3, height, width, 4))
    samples = filled(images, [2, 2, 2], tile=3)
    np.testing.assert_allclose(samples.coarser(COARSER).means, filled(images, [2, 2, 2], tile=3 * COARSER).means)
    np.testing.assert_allclose(samples.whole().means[:, 0, 0], images.mean((1, 2)))
    assert samples.coarser(COARSER).pixels.sum() == samples.whole().pixels.sum() == height * width


class TestAccumulator:
    """Batches on their way to tiles."""

    def test_memory_is_bounded_and_no_sample_lost(self, rng: np.random.Generator) -> None:
        many = 3 * MAX_BATCHES + 1
        images, counts = rng.uniform(size=(many, 2, 2, 4)), [int(n) for n in rng.integers(1, 9, many)]
        samples = filled(images, counts, tile=2)
        assert MAX_BATCHES / 2 <= len(samples.samples) <= MAX_BATCHES
        assert samples.samples.sum() == sum(counts)
        expected = np.average(images.mean((1, 2)), axis=0, weights=counts)
        np.testing.assert_allclose(samples.moments().mean[0, 0], expected)

    def test_the_first_batches_can_be_looked_at_alone(self) -> None:
        samples = filled(np.arange(5.0)[:, None, None, None] * np.ones((5, 4, 4, 4)), [3] * 5)
        np.testing.assert_allclose(samples.first(2).moments().mean, 0.5)

    def test_nothing_and_nonsense_are_refused(self) -> None:
        accumulator = TileAccumulator(4)
        with pytest.raises(ValueError, match="no batch"):
            accumulator.samples()
        with pytest.raises(ValueError, match="at least 1 sample"):
            accumulator.add(np.ones((8, 8, 4)), 0)
        accumulator.add(np.ones((8, 8, 4)), 1)
        with pytest.raises(ValueError, match=r"\(8, 8\), found \(8, 1\)"):
            accumulator.add(np.ones((8, 1, 4)), 1)
