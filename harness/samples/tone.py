"""From linear radiance to what a display shows: exposure, clipping, the sRGB curve."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def encode_srgb(image: ArrayLike, exposure: float = 0.0) -> np.ndarray:
    """Linear Rec.709 (..., 3) to display values in [0, 1]: times 2^exposure (stops), clipped, sRGB-encoded.

    The transfer function is that of IEC 61966-2-1. NaN stays NaN, infinity becomes white.
    """
    linear = np.asarray(np.asarray(image, dtype=np.float64) * 2.0**exposure)
    np.clip(linear, 0.0, 1.0, out=linear)
    encoded = np.asarray(linear**(1 / 2.4))  # then in place: half the time
    encoded *= 1.055
    encoded -= 0.055
    dark = linear <= 0.0031308
    encoded[dark] = 12.92 * linear[dark]
    return encoded


def decode_srgb(encoded: ArrayLike) -> np.ndarray:
    """Display values in [0, 1] to linear Rec.709, the inverse of `encode_srgb` at exposure 0."""
    values = np.asarray(encoded, dtype=np.float64)
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055)**2.4)
