"""The error that no number of samples removes: found where it is, not found where there is none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.stats.limit import limit_error

SHAPE = (48, 48, 3)


def merged(rng: np.random.Generator, truth: np.ndarray, sigma: float, replicas: int = 8, *,
           rare: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Mean of replicas and the variance of that mean; `rare`: share of pixels and replicas that hold a firefly."""
    images = truth + sigma * math.sqrt(replicas) * rng.standard_normal((replicas, *truth.shape))
    if rare:
        images += (rng.random(images.shape) < rare) / rare * 0.5 - 0.5
    return images.mean(0), images.var(0, ddof=1) / replicas


def stripes() -> np.ndarray:
    """Columns of 0.5 and 1.5 in turn: a texture whose tiles keep their means when it is shifted."""
    return np.broadcast_to(1 + 0.5 * (-1.0)**np.arange(SHAPE[1])[:, None], SHAPE)


def test_a_known_bias_lies_in_the_interval(rng: np.random.Generator) -> None:
    """A pattern of ±2 % around 1, below the noise of 5 % in a pixel, relative to the reference's RMS."""
    pattern = 0.02 * np.sign(rng.standard_normal(SHAPE))
    found = limit_error(*merged(rng, 1 + pattern, 0.05), *merged(rng, np.ones(SHAPE), 0.02))
    assert found.low < 0.02 < found.high
    assert found.high - found.low < 0.007
    assert found.value == pytest.approx(0.02, abs=0.003)


def test_what_averages_out_in_every_tile_is_found(rng: np.random.Generator) -> None:
    truth = stripes()
    shifted = limit_error(*merged(rng, 0.95 * truth + 0.05 * np.roll(truth, 1, axis=1), 0.05),
                          *merged(rng, truth, 0.05))
    assert shifted.low > 0.01
    assert limit_error(*merged(rng, truth, 0.01), *merged(rng, truth, 0.01)).high <= 0.01


@pytest.mark.parametrize("rare", [0.0, 0.01])
def test_an_unbiased_estimator_is_accused_no_more_often_than_stated(rng: np.random.Generator, rare: float) -> None:
    """The interval lies above zero by chance in at most 2.5 % of 400 comparisons, fireflies on one side included."""
    shape = (24, 24, 3)
    found = [limit_error(*merged(rng, np.ones(shape), 0.3, rare=rare), *merged(rng, np.ones(shape), 0.1))
             for _ in range(400)]
    accused = np.mean([each.low > 0 for each in found])
    assert accused < 0.025 + 3 * math.sqrt(0.025 * 0.975 / 400)
    assert np.mean([each.value > 0 for each in found]) == pytest.approx(0.5, abs=0.1), "no bias of its own"


def test_scale_is_the_references(rng: np.random.Generator) -> None:
    test, reference = merged(rng, np.full(SHAPE, 1.1), 0.01), merged(rng, np.ones(SHAPE), 0.01)
    plain = limit_error(*test, *reference)
    bright = limit_error(1e3 * test[0], 1e6 * test[1], 1e3 * reference[0], 1e6 * reference[1])
    assert plain.value == pytest.approx(0.1, rel=0.01) == bright.value
    black = limit_error(np.full(SHAPE, 0.2), np.zeros(SHAPE), np.zeros(SHAPE), np.zeros(SHAPE))
    assert black.value == pytest.approx(0.2), "absolute where the reference is black"


def test_unknown_variance_has_no_limit() -> None:
    one, unknown = np.ones(SHAPE), np.full(SHAPE, np.nan)
    found = limit_error(one, unknown, one, 0 * one)
    assert math.isnan(found.value) and math.isnan(found.high)


def test_images_of_different_sizes_are_refused() -> None:
    one = np.ones(SHAPE)
    with pytest.raises(HarnessError, match="one size"):
        limit_error(one, one, one[:1], one)
