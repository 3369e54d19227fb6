"""Value noise: its range and smoothness, its gradient, the bound on its steepness, and how random its lattice is."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats

from harness.scene.noise import NUMPY, OCTAVE, STEEPEST_NOISE, Triple, fbm, steepest_fbm, value_noise

SUMS = [(1, 2.0, 0.5), (4, 2.0, 0.5), (6, 1.7, 0.8), (3, 3.1, 1.0)]  # octaves, lacunarity, gain
# Each test of randomness may reject by chance once in 10,000 changes of the hash.
LEVEL = 1e-4


def points(count: int, extent: float = 40.0) -> Triple:
    """Random points around the origin, on both sides of it."""
    x, y, z = np.random.default_rng(3).uniform(-extent, extent, (3, count))
    return x, y, z


def lattice(side: int, seed: int) -> np.ndarray:
    """The values (side, side, side) on a block of the lattice that holds the origin."""
    axis = np.arange(side) - side // 2.0
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    return value_noise(NUMPY, (x, y, z), seed)[0]


def hashed(x: int, y: int, z: int, seed: int) -> float:
    """A lattice value from Python's integers: PCG's permutation of a sum, its upper 24 bits."""
    state = (x * 0x85EBCA77 + y * 0xC2B2AE3D + z * 0x165667B1 + seed * 747796405 + 2891336453) % 2**32
    word = ((state >> ((state >> 28) + 4)) ^ state) * 277803737 % 2**32
    return (word >> 8) / 2**24


def test_lattice_values_are_those_of_the_hash() -> None:
    """Exactly, below zero and for seeds up to 32 bits too."""
    places = [(0, 0, 0, 0), (1, 2, 3, 4), (-1, -1, -1, 0), (-500, 999, -7, 2**32 - 1), (2**20, -2**20, 5, 9)]
    for x, y, z, seed in places:
        found, _ = value_noise(NUMPY, (np.array([x * 1.0]), np.array([y * 1.0]), np.array([z * 1.0])), seed)
        assert found[0] == hashed(x, y, z, seed)


def test_noise_fills_its_range_about_its_middle() -> None:
    """Within [0, 1] everywhere, and one half on average."""
    for octaves, lacunarity, gain in SUMS:
        values, _ = fbm(NUMPY, points(200_000), octaves, lacunarity, gain, 5)
        assert values.min() >= 0 and values.max() <= 1
        assert values.mean() == pytest.approx(0.5, abs=0.005)  # some 512,000 cells, of which many share corners
    assert lattice(32, 1).min() < 0.001 and lattice(32, 1).max() > 0.999


@pytest.mark.parametrize(("octaves", "lacunarity", "gain"), SUMS)
def test_gradient_is_the_slope(octaves: int, lacunarity: float, gain: float) -> None:
    """Against central differences, which for a function with a bounded third derivative are off by h²."""
    p, step = points(2000), 1e-5
    _, gradient = fbm(NUMPY, p, octaves, lacunarity, gain, 11)
    for axis in range(3):
        ahead = tuple(c + step * (i == axis) for i, c in enumerate(p))
        behind = tuple(c - step * (i == axis) for i, c in enumerate(p))
        slope = (fbm(NUMPY, (ahead[0], ahead[1], ahead[2]), octaves, lacunarity, gain, 11)[0]
                 - fbm(NUMPY, (behind[0], behind[1], behind[2]), octaves, lacunarity, gain, 11)[0]) / (2 * step)
        np.testing.assert_allclose(gradient[axis], slope, atol=1e-6)


def test_noise_is_smooth_across_cells() -> None:
    """Value, slope and curvature run on from one cell into the next: on a line across 40 faces none of them jumps."""
    x = np.linspace(-20, 20, 400_001)
    step = x[1] - x[0]
    value, (slope, _, _) = value_noise(NUMPY, (x, 0 * x + 0.3, 0 * x - 0.7), 2)
    curvature = np.diff(slope) / step
    assert np.abs(np.diff(value)).max() <= STEEPEST_NOISE * step
    assert np.abs(curvature).max() < 6  # the quintic's is 5.8 at most
    assert np.abs(np.diff(curvature)).max() < 61 * step  # and its third derivative is 60; a jump would be of order 1


def test_nothing_is_steeper_than_the_bound() -> None:
    """All ways to put 0 and 1 on the corners of a cell: the bound is reached, and never exceeded."""
    axis = np.linspace(0, 1, 17)
    f = np.stack(np.meshgrid(axis, axis, axis, indexing="ij")).reshape(3, -1)
    low, high = 1 - (s := f**3 * (f * (6 * f - 15) + 10)), s
    slope = 30 * f**2 * (f - 1)**2
    corner = [[low[i], high[i]] for i in range(3)]
    others = ((1, 2), (0, 2), (0, 1))
    gradients = np.array([
        [slope[i] * corner[j][c[j]] * corner[k][c[k]] * (1 if c[i] else -1) for i, (j, k) in enumerate(others)]
        for c in itertools.product((0, 1), repeat=3)])
    steepest = max(np.linalg.norm(np.tensordot(values, gradients, 1), axis=0).max()
                   for values in itertools.product((0.0, 1.0), repeat=8))
    assert steepest == pytest.approx(STEEPEST_NOISE, rel=1e-12)


@pytest.mark.parametrize(("octaves", "lacunarity", "gain"), SUMS)
def test_sums_are_no_steeper_than_their_bound(octaves: int, lacunarity: float, gain: float) -> None:
    """And come within a factor of four of it: the bound adds up octaves that are seldom steep together."""
    _, gradient = fbm(NUMPY, points(200_000), octaves, lacunarity, gain, 1)
    found = np.linalg.norm(gradient, axis=0).max()
    assert found <= steepest_fbm(octaves, lacunarity, gain) < 4 * found


@pytest.mark.parametrize("seed", [0, 1, 77, 2**31])
def test_lattice_is_uniform_and_its_neighbours_independent(seed: int) -> None:
    """chi² of single values over 256 cells, and of pairs up to two cells apart over 16 x 16."""
    values = lattice(40, seed)
    assert stats.chisquare(np.bincount((values * 256).astype(int).ravel(), minlength=256)).pvalue > LEVEL / 4
    bins = (values * 16).astype(int)
    shifts = [s for s in itertools.product(range(-2, 3), repeat=3) if s > (0, 0, 0)]
    for shift in shifts:
        here = bins[tuple(slice(max(0, s), 40 + min(0, s)) for s in shift)]
        there = bins[tuple(slice(max(0, -s), 40 - max(0, s)) for s in shift)]
        pairs = np.bincount((here * 16 + there).ravel(), minlength=256)
        assert stats.chisquare(pairs).pvalue > LEVEL / 4 / len(shifts)


def test_seeds_and_octaves_are_uncorrelated() -> None:
    """The lattices of neighbouring seeds, and of the octaves of one sum, have nothing to do with one another."""
    seeds = [0, 1, 2, 1000, *(octave * OCTAVE for octave in range(1, 6))]
    fields = np.array([lattice(32, seed).ravel() for seed in seeds]) - 0.5
    correlation = np.corrcoef(fields)[np.triu_indices(len(seeds), 1)]
    assert np.abs(correlation).max() < stats.norm.isf(LEVEL / 2 / len(correlation)) / np.sqrt(fields.shape[1])
