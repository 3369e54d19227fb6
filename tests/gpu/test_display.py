"""The display pass against the sRGB formula."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.tracer import display


def srgb(linear: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1, clipped to [0, 1], in steps of 1/255 (not rounded)."""
    c = np.clip(linear, 0, 1)
    return 255 * np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055)


def ramp() -> np.ndarray:
    """Radiances (20, 30, 3) from 0 through both pieces of the curve to beyond white."""
    return np.concatenate([np.linspace(0, 0.004, 600), np.linspace(0.004, 1.3, 1200)]).reshape(20, 30, 3)


@pytest.mark.parametrize("exposure", [0.0, 1.5, -2.0])
def test_a_mean_is_exposed_and_encoded(exposure: float) -> None:
    """Within 1/255 of the formula, and exactly the nearest step but where rounding is a toss-up."""
    expected = srgb(ramp() * 2**exposure)
    shown = display(ramp(), exposure)
    assert shown.shape == (20, 30, 3) and shown.dtype == np.uint8
    assert np.abs(shown - expected).max() <= 0.51


def test_a_sum_is_divided_by_its_samples() -> None:
    """rgb over alpha, pixel by pixel; a pixel without samples is black."""
    samples = np.random.default_rng(1).integers(0, 5, (20, 30, 1))
    shown = display(np.concatenate([ramp() * samples, samples], axis=2))
    assert np.abs(shown - srgb(np.where(samples > 0, ramp(), 0))).max() <= 0.51


def test_rows_and_channels_keep_their_places() -> None:
    """Row 0 stays at the top, and red is the first channel."""
    image = np.zeros((3, 5, 3))
    image[0, 1, 0] = image[2, 4, 1] = 1.0
    np.testing.assert_array_equal(display(image), (255 * image).astype(np.uint8))


@pytest.mark.parametrize("shape", [(4, 4), (4, 4, 1), (4, 4, 5)])
def test_other_shapes_are_refused(shape: tuple[int, ...]) -> None:
    """Grey images and stacks are not guessed at."""
    with pytest.raises(ValueError, match=r"\(H, W, 3\) or \(H, W, 4\)"):
        display(np.zeros(shape))
