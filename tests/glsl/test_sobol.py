"""The sampler `sobol`: nets in every call, uniform and independent over replicas, with the variances of the theory."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy import stats

from harness.reference.draws import pixel_stream, rand, rand2, seed_sample
from harness.shader.samplers import with_sampler
from tests.support.tracer import evaluate, library

# The numbers of a path as glsl/probes/sobol.frag asks for them: columns of pairs, and of numbers by themselves.
PAIRS, ALONE = ((0, 1), (2, 3), (5, 6)), (4, 7)
NUMBERS = 8
LEVEL = 1e-4  # each test may reject by chance once in 10,000 changes of the sampler, its comparisons together
MASK = 0xFFFFFFFF


def draws(x: Any, y: Any, replica: Any, sample: Any) -> np.ndarray:
    """The numbers (N, 8) of samples of pixels."""
    x, y, replica, sample = np.broadcast_arrays(x, y, replica, sample)
    none = 0 * sample
    return evaluate("sobol.frag", np.stack([x, y, replica, none], axis=-1),
                    np.stack([sample >> 16, sample & 0xFFFF, none, none], axis=-1), outputs=2,
                    library=with_sampler(library(), "sobol")).astype(np.float64)


def runs(replicas: int, samples: int) -> np.ndarray:
    """The first samples of many replicas of a pixel, (replicas, samples, 8)."""
    replica, sample = (grid.ravel() for grid in np.meshgrid(np.arange(replicas), np.arange(samples), indexing="ij"))
    return draws(37, 11, replica, sample).reshape(replicas, samples, NUMBERS)


def reference(x: int, y: int, replica: int, sample: int) -> list[float]:
    """The same numbers from Python's integers, digit by digit: Sobol's second matrix as binomials modulo 2."""
    def output(state: int) -> int:
        word = (((state >> ((state >> 28) + 4)) ^ state) * 277803737) & MASK
        return (word >> 22) ^ word

    def pcg(value: int) -> int:
        return output((value * 747796405 + 2891336453) & MASK)

    def mirrored(value: int) -> int:
        return int(f"{value & MASK:032b}"[::-1], 2)

    def second(index: int) -> int:
        bits = [j for j in range(32) if index >> j & 1]
        return sum((sum(k & j == k for j in bits) & 1) << k for k in range(32))  # Lucas: binomial(j, k) is odd

    state = pcg(x + pcg(y + pcg(replica)))
    numbers: list[float] = []
    for pair in (True, True, False, True, False):
        word = output(state)
        mixed = (mirrored(sample) + state) & MASK
        shuffled = (mixed ^ (mixed * 0x05526C56 & MASK)) * (word | 1) & MASK
        index, upper = mirrored(shuffled), word >> 16
        if pair:
            found = [mirrored((index + word) * (state >> 16 | 1)),
                     mirrored((second(index) + (state ^ upper)) * (upper | 1))]
        else:
            found = [shuffled]
        numbers += [(number >> 8) / 2**24 for number in found]
        state = (state * 747796405 + 2891336453) & MASK
    return numbers


def test_numbers_are_those_of_the_sequence_bit_for_bit() -> None:
    rng = np.random.default_rng(5)
    place = np.c_[rng.integers(0, 16384, (60, 2)), rng.integers(0, 1000, 60)]
    samples = np.r_[np.arange(20), rng.integers(0, 2**32, 40)]
    expected = [reference(*map(int, row), int(sample)) for row, sample in zip(place, samples, strict=True)]
    np.testing.assert_array_equal(draws(*place.T, samples), expected)


def test_the_oracle_draws_the_same_numbers(mi: Any) -> None:
    """In drjit, of 100,000 samples anywhere."""
    rng = np.random.default_rng(6)
    place, sample = rng.integers([4096, 4096, 1024], size=(100_000, 3)), rng.integers(1 << 32, size=100_000)
    x, y, replica = (mi.UInt32(column.astype(np.uint32)) for column in place.T)
    state = seed_sample(pixel_stream(x, y, replica), mi.UInt32(sample.astype(np.uint32)), "sobol")
    numbers = []
    for pair in (True, True, False, True, False):
        *found, state = rand2(state) if pair else rand(state)
        numbers += [np.array(number) for number in found]
    np.testing.assert_array_equal(np.stack(numbers, axis=-1), draws(*place.T, sample))


@pytest.mark.parametrize("start", [0, 4096, 3 << 20])
def test_every_elementary_interval_holds_one_point(start: int) -> None:
    """A (0,2)-sequence: of each 2^k samples that begin at a multiple of 2^k, each box 2^-a by 2^-(k-a) holds one, and
    each 2^-k of a number by itself."""
    for x, replica in ((0, 0), (5, 3)):
        numbers = draws(x, 9, replica, start + np.arange(1024))
        for k in range(11):
            for block in (numbers[:1 << k], numbers[-1 << k:]):
                for column in ALONE:
                    assert len(np.unique((block[:, column] * 2**k).astype(int))) == 2**k
                for pair in PAIRS:
                    for a in range(k + 1):
                        cells = (block[:, pair] * [2**a, 2**(k - a)]).astype(int)
                        assert len(np.unique(cells[:, 0] << 16 | cells[:, 1])) == 2**k


@pytest.mark.parametrize("sample", [0, 1, 6, 1000])
def test_each_number_is_uniform_over_replicas_and_knows_of_no_other(sample: int) -> None:
    """So that means are unbiased: chi² of each in 256 cells, of any two of a sample in 32 x 32, over 65,536."""
    numbers = draws(37, 11, np.arange(1 << 16), sample)
    assert numbers.min() >= 0 and numbers.max() < 1
    comparisons = 4 * (NUMBERS + NUMBERS * (NUMBERS - 1) // 2)
    for one in range(NUMBERS):
        counts = np.bincount((numbers[:, one] * 256).astype(int), minlength=256)
        assert stats.chisquare(counts).pvalue > LEVEL / comparisons
        for other in range(one):
            cells = (numbers[:, one] * 32).astype(int) * 32 + (numbers[:, other] * 32).astype(int)
            assert stats.chisquare(np.bincount(cells, minlength=1024)).pvalue > LEVEL / comparisons


def test_pixels_know_nothing_of_each_other() -> None:
    """Means of 8 samples, of each number and of products of calls, in a square of 128² pixels and two replicas: no
    correlation between neighbours, nor between replicas."""
    side, samples = 128, 8
    y, x, replica, sample = (grid.ravel() for grid in np.meshgrid(
        np.arange(side), np.arange(side), np.arange(2), np.arange(samples), indexing="ij"))
    numbers = draws(x, y, replica, sample).reshape(side, side, 2, samples, NUMBERS) - 0.5
    products = np.stack([numbers[..., a] * numbers[..., b] for a, b in pairwise(range(NUMBERS))], axis=-1)
    means = np.concatenate([numbers, products], axis=-1).mean(axis=3)
    means /= means.std(axis=(0, 1, 2))
    found = [(means[:-1] * means[1:]), (means[:, :-1] * means[:, 1:]), (means[:, :, :1] * means[:, :, 1:])]
    correlations = np.concatenate([each.mean(axis=(0, 1, 2)) * np.sqrt(each[..., 0].size) for each in found])
    assert np.abs(correlations).max() < stats.norm.isf(LEVEL / 2 / len(correlations))


def squares(means: np.ndarray, expected: float) -> np.ndarray:
    """By how many standard errors the mean square of columns of means (R, C) differs from what is expected."""
    values = means**2
    error = values.std(axis=0, ddof=1) / np.sqrt(len(values))
    return np.abs(values.mean(axis=0) - expected) / error


@pytest.mark.parametrize("samples", [4, 16])
def test_variances_are_those_of_owens_scrambling(samples: int) -> None:
    """Of the mean of a number of a pair: 1 / (12 N³), one jittered point in each of N cells. Of a number by itself:
    1 / (12 N²), one shift for all. Of a product of two calls' numbers: 1.58 times that of independent samples.

    Two samples whose indices part at bit h have numbers that part at digit h + 1 with probability 2^-h, so their
    covariance is -2^(-3h-4), and there are 2^h such partners: 1 + 144 Σ 2^h 2^(-6h-8).
    """
    numbers = runs(8192, samples) - 0.5
    limit = stats.norm.isf(LEVEL / 2 / 40)
    in_pairs = [column for pair in PAIRS for column in pair]
    assert squares(numbers[..., in_pairs].mean(axis=1), 1 / (12 * samples**3)).max() < limit
    assert squares(numbers[..., ALONE].mean(axis=1), 1 / (12 * samples**2)).max() < limit
    depth = samples.bit_length() - 1
    gain = 1 + 144 * sum(2.0**h * 2.0**(-6 * h - 8) for h in range(depth))
    calls = [(0, 2), (1, 3), (0, 5), (2, 6), (1, 2), (3, 5), (3, 6)]
    products = np.stack([numbers[..., a] * numbers[..., b] for a, b in calls], axis=-1).mean(axis=1)
    assert squares(products, gain / (144 * samples)).max() < limit
    others = np.stack([numbers[..., a] * numbers[..., b] for a, b in ((1, 4), (4, 7), (3, 7), (4, 6))], axis=-1)
    assert (others.mean(axis=1) ** 2).mean(axis=0).max() < gain / (144 * samples)


def test_errors_of_calls_have_no_long_tails() -> None:
    """Products of numbers of two calls at 256 samples: a kurtosis near 3. Where the shuffle is a sum and a product
    alone it is 40, of pixels whose calls go together."""
    numbers = runs(2048, 256) - 0.5
    products = np.stack([numbers[..., a] * numbers[..., b] for a, b in ((0, 2), (2, 5), (0, 4), (4, 7))], axis=-1)
    assert stats.kurtosis(products.mean(axis=1), fisher=False).max() < 6
