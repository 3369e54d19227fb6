"""The image of any program as linear radiance: each format one module, chosen by the file's first bytes.

To add a format, write a module with `read(path, data)`, which returns a `ReadImage` and raises StoreError in one line,
and put it into `FORMATS`. Suffixes serve to find files in folders, never to tell what a file is.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from harness.errors import StoreError
from harness.samples.exr import MAGIC, read_bytes, read_exr
from harness.samples.readers import hdr, pfm, raster
from harness.samples.readers.base import ReadImage

__all__ = ["SUFFIXES", "ReadImage", "read_image"]

# Attributes in which renderers note their samples per pixel: ours and Mitsuba scripts', pbrt-v4's, Cycles's.
_SPP = re.compile(r"spp|samplesPerPixel|cycles\..*\.samples")


def _read_exr(path: Path, data: bytes) -> ReadImage:
    found = read_exr(path)
    estimate = found.estimate
    known = estimate.batches != 1 and not np.isnan(estimate.image_variance).any()
    return ReadImage(estimate.mean, found.metadata, spp=_spp(found.metadata) or estimate.samples or None,
                     notes=found.notes, estimate=estimate if known else None)


# The first bytes -> what reads the rest.
FORMATS: dict[bytes, Callable[[Path, bytes], ReadImage]] = {
    MAGIC: _read_exr,
    b"PF": pfm.read, b"Pf": pfm.read,
    b"#?": hdr.read,
    b"\x89PNG": raster.read, b"\xff\xd8\xff": raster.read,
}
SUFFIXES = (".exr", ".pfm", ".hdr", ".pic", ".png", ".jpg", ".jpeg")


def read_image(path: str | Path) -> ReadImage:
    """Read the image of any program: EXR, PFM, Radiance HDR, PNG of 8 or 16 bits, JPEG.

    StoreError, in one line, when the file is missing, damaged, or of another format.
    """
    path = Path(path)
    data = read_bytes(path, "image")
    if not data:
        raise StoreError(f"{path}: an empty file; render it again")
    for magic, read in FORMATS.items():
        if data.startswith(magic):
            return read(path, data)
    raise StoreError(f"{path}: not an image that is understood; write EXR, PFM, Radiance HDR, PNG or JPEG")


def _spp(metadata: dict[str, str | int | float]) -> int | None:
    """The samples per pixel that a renderer noted, as a number or as decimal text."""
    for name, value in metadata.items():
        if _SPP.fullmatch(name) and str(value).isdecimal() and int(value) > 0:
            return int(value)
    return None
