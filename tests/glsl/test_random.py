"""The random numbers: uniform, uncorrelated between neighbours of every kind, and no stream used twice."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tests.support.tracer import evaluate

DRAWS = 8
# Rows in the plane of pixels, samples or replicas that a test looks at.
SIDE = 256
# Each test here may reject by chance once in 10,000 changes of the generator, its many comparisons together.
LEVEL = 1e-4


def draws(x: np.ndarray, y: np.ndarray, replica: np.ndarray, sample: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first numbers (N, 8) of samples of pixels, and the seeds (N,) uint32 they began from."""
    place = np.stack(np.broadcast_arrays(x, y, replica, 0), axis=-1)
    index = np.broadcast_to(np.asarray(sample, dtype=np.int64), place.shape[:1])
    found = evaluate("random.frag", place, np.stack([index >> 16, index & 0xFFFF, 0 * index, 0 * index], axis=-1),
                     outputs=3)
    seeds = found[:, 8].astype(np.uint32) << 16 | found[:, 9].astype(np.uint32)
    return found[:, :DRAWS].astype(np.float64), seeds


def plane(name: str) -> np.ndarray:
    """Numbers (SIDE, SIDE, 8) whose second axis is the neighbourhood in question."""
    first, second = (grid.ravel() for grid in np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij"))
    rows = {
        "pixels along x": (second, first, 0, 0),
        "pixels along y": (first, second, 0, 0),
        "samples": (first, 100, 0, second),
        "late samples": (first, 100, 0, 2**31 + second),
        "replicas": (first, 100, second, 0),
    }[name]
    x, y, replica, sample = np.broadcast_arrays(*rows)
    return draws(x, y, replica, sample)[0].reshape(SIDE, SIDE, DRAWS)


NEIGHBOURHOODS = ["pixels along x", "pixels along y", "samples", "late samples", "replicas"]


def reference(x: int, y: int, replica: int, sample: int) -> list[float]:
    """The same numbers from Python's integers: PCG-RXS-M-XS-32 as O'Neill's paper gives it."""
    def output(state: int) -> int:
        word = (((state >> ((state >> 28) + 4)) ^ state) * 277803737) & 0xFFFFFFFF
        return (word >> 22) ^ word

    def step(state: int) -> int:
        return (state * 747796405 + 2891336453) & 0xFFFFFFFF

    def pcg(value: int) -> int:
        return output(step(value & 0xFFFFFFFF))

    key = pcg(x + pcg(y + pcg(replica)))
    state = (pcg(sample ^ key) + pcg(key ^ 0x9E3779B9)) & 0xFFFFFFFF
    numbers = []
    for _ in range(DRAWS):
        numbers.append((output(state) >> 8) / 2**24)
        state = step(state)
    return numbers


def test_numbers_are_those_of_the_published_generator() -> None:
    """Bit for bit, which also shows that nothing depends on a driver's float arithmetic."""
    rng = np.random.default_rng(2)
    places = np.c_[rng.integers(0, 16384, (50, 2)), rng.integers(0, 1000, 50)]
    samples = rng.integers(0, 2**32, 50)
    found, _ = draws(*places.T, samples)
    expected = [reference(int(x), int(y), int(r), int(s)) for (x, y, r), s in zip(places, samples, strict=True)]
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("name", NEIGHBOURHOODS)
def test_numbers_are_uniform(name: str) -> None:
    """Each of the first eight numbers, over 65,536 neighbours: chi² over 256 cells; within [0, 1)."""
    numbers = plane(name).reshape(-1, DRAWS)
    assert numbers.min() >= 0 and numbers.max() < 1
    for draw in numbers.T:
        counts = np.bincount((draw * 256).astype(int), minlength=256)
        assert stats.chisquare(counts).pvalue > LEVEL / DRAWS / len(NEIGHBOURHOODS)


@pytest.mark.parametrize("name", NEIGHBOURHOODS)
def test_neighbours_are_uncorrelated(name: str) -> None:
    """The same and different numbers of neighbours 1 to 4 apart: every correlation is within chance."""
    numbers = (plane(name) - 0.5) * np.sqrt(12)  # unit variance
    correlations = []
    for lag in range(1, 5):
        here, there = numbers[:, :-lag].reshape(-1, DRAWS), numbers[:, lag:].reshape(-1, DRAWS)
        correlations += list((here.T @ there / np.sqrt(len(here))).ravel())
    comparisons = len(correlations) * len(NEIGHBOURHOODS)
    assert np.abs(correlations).max() < stats.norm.isf(LEVEL / 2 / comparisons)


def test_numbers_of_one_sample_are_uncorrelated() -> None:
    """Pairs among the first eight, which place a sample in the pixel and choose its first directions."""
    numbers = (plane("samples").reshape(-1, DRAWS) - 0.5) * np.sqrt(12)
    matrix = numbers.T @ numbers / np.sqrt(len(numbers))
    pairs = matrix[np.triu_indices(DRAWS, 1)]
    assert np.abs(pairs).max() < stats.norm.isf(LEVEL / 2 / len(pairs))


def test_pairs_fill_the_square() -> None:
    """The jitter in the pixel, (number 1, number 2), over the samples of single pixels: chi² in 16 x 16 cells."""
    for x in range(4):
        numbers, _ = draws(np.full(65536, x), np.full(65536, 7), np.zeros(65536), np.arange(65536))
        cells = (numbers[:, 0] * 16).astype(int) * 16 + (numbers[:, 1] * 16).astype(int)
        assert stats.chisquare(np.bincount(cells, minlength=256)).pvalue > LEVEL / 4


def test_no_two_samples_of_a_pixel_share_a_stream() -> None:
    """The first 262,144 samples, and the last, start from as many different seeds."""
    count = 1 << 18
    for start in (0, 2**32 - count):
        _, seeds = draws(np.full(count, 13), np.full(count, 5), np.full(count, 3), start + np.arange(count))
        assert len(np.unique(seeds)) == count


def test_pixels_and_replicas_do_not_share_streams() -> None:
    """A pixel's seeds are not a neighbour's in another order: four thousand samples of each have none in common."""
    samples = np.arange(4096)
    _, base = draws(np.full(4096, 40), np.full(4096, 2), np.zeros(4096), samples)
    for x, y, replica in [(41, 2, 0), (40, 3, 0), (40, 2, 1)]:
        _, other = draws(np.full(4096, x), np.full(4096, y), np.full(4096, replica), samples)
        # Of 4096 random seeds out of 2^32 about 0.004 are expected to be shared.
        assert len(np.intersect1d(base, other)) <= 1
