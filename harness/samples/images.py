"""Images ready to look at: 8-bit sRGB PNG and JPEG files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from harness.files import write_atomically
from harness.samples.tone import encode_srgb

# What a NaN pixel looks like: a colour that no one takes for part of the scene.
NAN_COLOUR = (255, 0, 255)
# Of JPEGs: noise of a finished picture is gone, edges are clean, at a tenth of the PNG's size.
QUALITY = 88


def display_pixels(image: np.ndarray, exposure: float = 0.0) -> np.ndarray:
    """Linear Rec.709 (H, W, 3) as 8-bit sRGB at an exposure in stops; pixels with a NaN become magenta."""
    encoded = encode_srgb(image, exposure)
    broken = np.isnan(encoded).any(axis=-1)
    pixels = np.round(255 * np.nan_to_num(encoded)).astype(np.uint8)
    pixels[broken] = NAN_COLOUR
    return pixels


def write_png(path: str | Path, image: np.ndarray, exposure: float = 0.0) -> None:
    """Write linear Rec.709 (H, W, 3) as displayed at an exposure in stops; StoreError when it cannot be written."""
    with write_atomically(path) as partial:
        Image.fromarray(display_pixels(image, exposure)).save(partial, format="PNG", optimize=True)


def write_jpeg(path: str | Path, image: np.ndarray, exposure: float = 0.0) -> None:
    """The same as a JPEG, to be kept for long."""
    with write_atomically(path) as partial:
        Image.fromarray(display_pixels(image, exposure)).save(partial, format="JPEG", quality=QUALITY, optimize=True)
