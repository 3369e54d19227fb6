"""PNG and JPEG files as linear radiance: sRGB decoded, and a word on what their clipping hides."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import numpy as np
from PIL import Image, ImageFile

from harness.errors import StoreError
from harness.samples.readers.base import ReadImage
from harness.samples.tone import decode_srgb


def read(path: Path, data: bytes) -> ReadImage:
    """Read a PNG of 8 or 16 bits or a JPEG; transparent pixels are shown over black.

    StoreError when the file is damaged, larger than any render, or neither grey nor RGB.
    """
    try:
        with warnings.catch_warnings(), _opened(data) as file:
            warnings.simplefilter("ignore")  # of sizes that only a picture from a stranger on the net may not have
            if file.mode == "CMYK" or (file.tile and file.tile[0][3] == "LA;16B"):
                raise StoreError(f"{path}: CMYK, or grey of 16 bits with alpha; write it as RGB")
            levels, codes = _codes(file, data)
            kind, profile = file.format or "", "icc_profile" in file.info
    except StoreError:
        raise
    except Exception as error:  # the library raises whatever its many decoders do
        raise StoreError(f"{path}: truncated or damaged image; write it again") from error
    colours, alpha = codes[..., :3], codes[..., 3:] / levels
    image = decode_srgb(colours / levels)
    white, black = (float((colours == end).any(axis=-1).mean()) for end in (levels, 0))
    notes = [f"{kind} is taken as sRGB of {levels.bit_length()} bits: {white:.2%} of the pixels are clipped at white, "
             f"{black:.2%} have a channel at 0; what is brighter or darker is hidden: write EXR or PFM for a verdict"]
    if kind != "PNG":
        notes.append("JPEG leaves out detail, noise first of all: its noise is not the render's")
    if profile:
        notes.append("its ICC profile is not applied")
    if alpha.size and (share := float((alpha < 1).mean())):
        image = image * alpha
        notes.append(f"alpha is below 1 in {share:.2%} of the pixels, which are shown over black")
    return ReadImage(image, notes=tuple(notes))


def _codes(file: ImageFile.ImageFile, data: bytes) -> tuple[int, np.ndarray]:
    """The largest code value, and code values (H, W, 3 or 4) as stored."""
    raw = str(file.tile[0][3]) if file.tile else ""
    if raw in ("RGB;16B", "RGBA;16B"):
        # Pillow keeps only the first byte of each value; read as if the bytes stood the other way round, the second.
        planes = []
        for order in ("16B", "16L"):
            with _opened(data) as again:
                again.tile = [again.tile[0]._replace(args=f"{again.mode};{order}")]
                planes.append(np.asarray(again).astype(np.uint16))
        return 65535, planes[0] * 256 + planes[1]
    if file.mode.startswith("I"):
        return 65535, np.repeat(np.asarray(file).astype(np.uint16)[..., None], 3, axis=-1)
    transparent = file.mode in ("RGBA", "LA", "PA") or "transparency" in file.info
    return 255, np.asarray(file.convert("RGBA" if transparent else "RGB"))


def _opened(data: bytes) -> ImageFile.ImageFile:
    return Image.open(io.BytesIO(data), formats=("PNG", "JPEG", "MPO"))
