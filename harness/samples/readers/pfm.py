"""Portable float maps (.pfm): float32 RGB or grey, either byte order, rows from the bottom."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from harness.errors import StoreError
from harness.samples.readers.base import ReadImage

# Debevec's format: "PF" or "Pf", width, height, a scale whose sign is the byte order, one white space, the pixels.
_HEADER = re.compile(rb"P([Ff])\s+(\d{1,9})\s+(\d{1,9})\s+([-+]?[0-9.]+(?:[eE][-+]?\d+)?)\s")


def read(path: Path, data: bytes) -> ReadImage:
    """Read a PFM file; StoreError when its header is not one, or pixels are missing."""
    header = _HEADER.match(data)
    try:
        width, height, scale = (int(header[2]), int(header[3]), float(header[4])) if header else (0, 0, 0.0)
    except ValueError:
        width, height, scale = 0, 0, 0.0
    if header is None or not (width and height and scale):
        raise StoreError(f"{path}: not a PFM file: expected 'PF', width, height, and a scale other than 0; "
                         "write it again")
    channels = 3 if header[1] == b"F" else 1
    found, needed = len(data) - header.end(), 4 * width * height * channels
    if found < needed:
        raise StoreError(f"{path}: truncated PFM file: {needed} bytes of pixels expected, {found} found; "
                         "write it again")
    kind = np.dtype("<f4" if scale < 0 else ">f4")
    pixels = np.frombuffer(data, kind, width * height * channels, header.end()).reshape(height, width, channels)
    image = np.repeat(pixels[::-1], 3 // channels, axis=-1).astype(np.float64) * abs(scale)
    notes = () if abs(scale) == 1 else (f"its pixels are multiplied by the header's scale, {abs(scale):g}",)
    return ReadImage(image, notes=notes)


def write(path: Path, image: np.ndarray) -> None:
    """Write (H, W, 3) as a little-endian PFM file."""
    height, width = image.shape[:2]
    path.write_bytes(b"PF\n%d %d\n-1.0\n" % (width, height) + image[::-1].astype("<f4").tobytes())
