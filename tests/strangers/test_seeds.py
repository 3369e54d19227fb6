"""Random numbers that repeat are found, and those that do not are not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from harness.strangers.seeds import find_repeats

SHAPE = (128, 12, 16)
Noise = Callable[[np.random.Generator, tuple[int, ...]], np.ndarray]


def ramp(shape: tuple[int, ...]) -> np.ndarray:
    return np.linspace(0.0, 1.0, shape[-1])


# What samples of right shaders look like: even, rare and bright, heavy-tailed, constant in half of the image.
RIGHT: dict[str, Noise] = {
    "even": lambda rng, shape: rng.random(shape),
    "rare": lambda rng, shape: (rng.random(shape) < 0.05) * 20.0,
    "heavy": lambda rng, shape: rng.exponential(1.0, shape)**3,
    "fireflies": lambda rng, shape: rng.random(shape) * ramp(shape) + (rng.random(shape) < 0.003) * 1000.0,
    "half": lambda rng, shape: np.where(ramp(shape) < 0.5, 1.0, rng.random(shape)),
}


def kinds(frames: np.ndarray) -> set[str]:
    return {repeat.kind for repeat in find_repeats(frames)}


@pytest.mark.parametrize("noise", RIGHT.values(), ids=RIGHT)
def test_right_noise_is_not_accused(noise: Noise) -> None:
    accused = [seed for seed in range(12) if kinds(noise(np.random.default_rng(seed), SHAPE))]
    assert not accused


@pytest.mark.parametrize("noise", RIGHT.values(), ids=RIGHT)
def test_frames_that_come_again_are_found(noise: Noise) -> None:
    half = noise(np.random.default_rng(1), (64, 12, 16))
    assert kinds(np.concatenate([half, half])) == {"period"}
    assert kinds(np.concatenate([half[:1]] * 64)) == {"frames_equal"}


def test_frames_that_overlap_are_found_with_their_lag() -> None:
    rng = np.random.default_rng(2)
    draws = rng.random((SHAPE[0] + 9, *SHAPE[1:]))
    found = [repeat for repeat in find_repeats(draws[9:] + 0.5 * draws[:-9]) if repeat.kind == "lag"]
    assert found and "frames 9 apart" in found[0].told and not found[0].harmless


def test_pixels_that_share_are_found_with_their_distance() -> None:
    rng = np.random.default_rng(3)
    wide = rng.random((SHAPE[0], SHAPE[1], SHAPE[2] + 3))
    found = [repeat for repeat in find_repeats(wide[..., 3:] + 0.5 * wide[..., :-3]) if repeat.kind == "neighbours"]
    assert found and "(3, 0) apart" in found[0].told


def test_a_sequence_that_is_spread_evenly_is_no_fault() -> None:
    """Kronecker's of the golden ratio, begun anywhere at each pixel: frames 13, 21, … apart are alike, and their means
    are far better than of independent numbers."""
    rng = np.random.default_rng(5)
    frames = np.arange(SHAPE[0])[:, None, None]
    even = (rng.random(SHAPE[1:]) + 0.6180339887498949 * frames) % 1.0
    found = [repeat for repeat in find_repeats(even**2) if repeat.kind == "lag"]
    assert [repeat.harmless for repeat in found] == [True] and "spread evenly" in found[0].told


@pytest.mark.parametrize(("common", "harmless"), [(0.35, True), (1.5, False)])
def test_pixels_that_share_little_are_no_fault(common: float, harmless: bool) -> None:
    rng = np.random.default_rng(6)
    own, others = rng.random((2, *SHAPE))
    found = find_repeats(own + common * np.roll(others, 4, axis=2) + common * others)
    assert [repeat.harmless for repeat in found if repeat.kind == "neighbours"] == [harmless]


def test_pixels_that_are_others_noise_are_found() -> None:
    rng = np.random.default_rng(4)
    columns = rng.random((SHAPE[0], 1, SHAPE[2]))
    picture = 1.0 + rng.random(SHAPE[1:])
    assert "pixels" in kinds(columns * picture)


def test_a_picture_without_noise_is_none_that_ignores_its_seed() -> None:
    smooth = np.add.outer(np.linspace(1.0, 2.0, 12), np.linspace(0.0, 1.0, 16))
    assert not kinds(np.broadcast_to(smooth, (64, 12, 16)).copy())
    assert not kinds(np.ones((64, 12, 16)))
