"""Equidistribution and independence of the random numbers: bits, pairs, triples, far lags, and noise as rendered.

test_random.py has the generator itself, its uniformity and its neighbours. Every test here may reject by chance once in
10,000 changes of the generator, its comparisons together; the handout's generator fails where the name says so.
"""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from harness.course.variants import OURS, RANDOM, Variant
from harness.samples.estimate import luminance
from harness.scene import load_scene
from tests.support.tracer import TracerRenderer

LEVEL = 1e-4
BITS = 24
COUNT = 1 << 16
SCENES = Path(__file__).parents[2] / "mitsuba_scenes"
# What a sample draws first: its place in the pixel, then on the lens and in time or its first direction.
FIRST = 6
# Apart by what an image, a pass or the store's schedule may be long.
LAGS = (1, 2, 3, 16, 64, 100, 128, 256, 512, 1000, 1024, 4096)


def draws(variant: Variant, x: np.ndarray, y: np.ndarray, replica: np.ndarray, sample: np.ndarray) -> np.ndarray:
    """The first eight numbers (N, 8) of samples of pixels; arguments broadcast to (N,)."""
    x, y, replica, sample = np.broadcast_arrays(x, y, replica, sample)
    nothing = np.zeros(len(x))
    return variant.probe("random.frag", np.stack([x, y, replica, nothing], axis=-1),
                         np.stack([sample >> 16, sample & 0xFFFF, nothing, nothing], axis=-1), outputs=3)[:, :8]


def population(name: str, variant: Variant = OURS) -> np.ndarray:
    """Numbers (COUNT, 8) of many samples of a pixel, of many pixels in one sample, or of many replicas."""
    many, none = np.arange(COUNT), np.zeros(COUNT, dtype=int)
    place = {"samples": (none + 37, none + 11, none, many), "pixels": (many % 256, many // 256, none, none + 5),
             "replicas": (none + 37, none + 11, many, none)}[name]
    return draws(variant, *place)


POPULATIONS = ["samples", "pixels", "replicas"]


@pytest.mark.parametrize("name", POPULATIONS)
def test_every_bit_is_fair(name: str) -> None:
    """Each of the 24 bits of each of the first eight numbers is set in half of all draws."""
    whole = (population(name) * 2**BITS).astype(np.int64)
    ones = ((whole[..., None] >> np.arange(BITS)) & 1).sum(axis=0)
    deviation = np.abs(ones - COUNT / 2) / np.sqrt(COUNT / 4)
    assert deviation.max() < stats.norm.isf(LEVEL / 2 / ones.size)


@pytest.mark.parametrize("name", POPULATIONS)
def test_any_two_numbers_fill_the_square(name: str) -> None:
    """All pairs of the first six, which place a sample in pixel, lens and shutter: χ² in 16 × 16 cells."""
    cells = (population(name)[:, :FIRST] * 16).astype(int)
    pairs = list(combinations(range(FIRST), 2))
    for a, b in pairs:
        counts = np.bincount(cells[:, a] * 16 + cells[:, b], minlength=256)
        assert stats.chisquare(counts).pvalue > LEVEL / len(pairs), (a, b)


@pytest.mark.parametrize("name", POPULATIONS)
def test_any_three_numbers_fill_the_cube(name: str) -> None:
    """All triples of the first six: χ² in 8 × 8 × 8 cells; lattices of poor generators show there."""
    cells = (population(name)[:, :FIRST] * 8).astype(int)
    triples = list(combinations(range(FIRST), 3))
    for triple in triples:
        counts = np.bincount(cells[:, triple] @ [64, 8, 1], minlength=512)
        assert stats.chisquare(counts).pvalue > LEVEL / len(triples), triple


@pytest.mark.parametrize("axis", ["passes", "columns", "rows", "replicas"])
@pytest.mark.parametrize("start", [0, 1_000_000], ids=["first pass", "pass 1,000,000"])
def test_numbers_far_apart_are_uncorrelated(axis: str, start: int) -> None:
    """The same number of pixels, passes and replicas up to 4096 apart."""
    assert largest_correlation(OURS, axis, start) < stats.norm.isf(LEVEL / 2 / (len(LAGS) * 8))


def test_far_rows_show_the_handouts_generator() -> None:
    """The same statistic on it: at pass 1,000,000 rows are not independent, at the first pass they seem to be."""
    limit = stats.norm.isf(LEVEL / 2 / (len(LAGS) * 8))
    assert largest_correlation(RANDOM, "rows", 1_000_000) > 10 * limit
    assert largest_correlation(RANDOM, "rows", 0) < limit


def largest_correlation(variant: Variant, axis: str, start: int) -> float:
    """The largest correlation over LAGS and the first eight numbers, in standard errors, of 16,384 pairs each."""
    other, along = (grid.ravel() for grid in np.meshgrid(np.arange(128), np.arange(128), indexing="ij"))
    found = []

    def numbers(lag: int) -> np.ndarray:
        place = {"passes": (other, 3, 0, start + along + lag), "columns": (along + lag, other, 0, start),
                 "rows": (other, along + lag, 0, start), "replicas": (other, 3, along + lag, start)}[axis]
        return (draws(variant, *map(np.asarray, place)) - 0.5) * np.sqrt(12)

    base = numbers(0)
    for lag in LAGS:
        found.append(np.abs((base * numbers(lag)).sum(axis=0)) / np.sqrt(len(base)))
    return float(np.max(found))


@pytest.mark.parametrize(("variant", "independent"), [(OURS, True), (RANDOM, False)], ids=["ours", "handout"])
def test_rendered_noise_is_white(variant: Variant, independent: bool) -> None:
    """Noise of late passes, pixel by pixel: uncorrelated between columns, rows, runs of passes and replicas.

    The handout's generator knows no replicas, and gives neighbouring rows the same noise.
    """
    scene = load_scene(SCENES / "furnace_cube.xml", width=64, height=64)
    renderer = TracerRenderer(scene, "uniform", variant.library.tracer(scene, "uniform"))
    batches = [luminance(renderer.render_batch(replica, start, 8).mean)
               for replica in (0, 1) for start in range(1_000_000, 1_000_256, 8)]
    renderer.release()
    stack = np.array(batches)
    noise = (stack - stack.mean(axis=0)) / np.where(stack.std(axis=0) > 0, stack.std(axis=0), 1)
    half = len(noise) // 2
    tests = {"columns": (noise[:, :, 1:], noise[:, :, :-1]), "rows": (noise[:, 1:], noise[:, :-1]),
             "passes": (noise[1:half], noise[:half - 1]), "replicas": (noise[:half], noise[half:])}
    found = {name: float(abs((a * b).sum()) / np.sqrt((a * a * b * b).sum())) for name, (a, b) in tests.items()}
    # Deviations from a pixel's own mean over M batches are correlated by -1/(M-1) in themselves: that much is allowed.
    limit = {name: stats.norm.isf(LEVEL / 2 / len(tests)) + (np.sqrt(a.size) / (len(noise) - 1) if name in
             ("passes", "replicas") else 0) for name, (a, _) in tests.items()}
    exceeded = {name for name in tests if found[name] > limit[name]}
    assert (exceeded == set()) == independent, (found, limit)
    assert independent or {"rows", "replicas"} <= exceeded
