"""Radiance pictures (.hdr, .pic): 8 bits a channel and a shared exponent, plain or run-length encoded."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from harness.errors import StoreError
from harness.samples.readers.base import ReadImage

_RESOLUTION = re.compile(rb"([-+])Y (\d{1,9}) ([-+])X (\d{1,9})\n")
# Scanlines of such widths may be run-length encoded channel by channel; wider and narrower ones never are.
_ENCODED_WIDTHS = range(8, 1 << 15)
_ROUNDED = ("a format of 8 bits a channel and a shared exponent: values are rounded by up to 0.4 % of a pixel's "
            "largest channel; write EXR or PFM for a verdict on less")


def read(path: Path, data: bytes) -> ReadImage:
    """Read a Radiance picture (Ward, "Real Pixels", Graphics Gems II, 1991; Radiance's color.c).

    A mantissa m stands for (m + 1/2) / 256, as in Radiance: writers cut what is below the last bit off. StoreError when
    the file is cut short, in XYZ, or stored by columns.
    """
    head, gap, rest = data.partition(b"\n\n")
    lines = head.decode("latin-1").splitlines()[1:]
    fields = dict(line.split("=", 1) for line in lines if "=" in line and not line.startswith("#"))
    kind = fields.get("FORMAT", "").strip()
    resolution = _RESOLUTION.match(rest)
    if not gap or kind != "32-bit_rle_rgbe" or not resolution or not (int(resolution[2]) and int(resolution[4])):
        raise StoreError(f"{path}: expected a Radiance picture of FORMAT=32-bit_rle_rgbe, stored by rows, found "
                         f"{f'FORMAT={kind}' if kind else 'no FORMAT'}; write it again, as RGB, or as EXR")
    height, width = int(resolution[2]), int(resolution[4])
    try:
        rgbe = _scanlines(np.frombuffer(rest, np.uint8, offset=resolution.end()), height, width)
    except (IndexError, ValueError):
        raise StoreError(f"{path}: truncated or damaged Radiance picture; write it again") from None
    image = np.where(rgbe[..., 3:] > 0, (rgbe[..., :3] + 0.5) * 2.0**(rgbe[..., 3:].astype(np.float64) - 136), 0.0)
    image = image[::1 if resolution[1] == b"-" else -1, ::1 if resolution[3] == b"+" else -1]
    exposure = _exposure(path, lines)
    notes = (_ROUNDED,) if exposure == 1 else (_ROUNDED, f"its EXPOSURE of {exposure:g} is divided out")
    return ReadImage(image / exposure, fields, notes=notes)


def _exposure(path: Path, lines: list[str]) -> float:
    """The product of all exposures that the header says the pixels were multiplied by."""
    exposure = 1.0
    for line in lines:
        if line.startswith("EXPOSURE="):
            try:
                exposure *= float(line.partition("=")[2])
            except ValueError:
                exposure = 0.0
    if not 0 < exposure < float("inf"):
        raise StoreError(f"{path}: its EXPOSURE must be a number above 0; write it again")
    return exposure


def _scanlines(data: np.ndarray, height: int, width: int) -> np.ndarray:
    """(height, width, 4) bytes; IndexError or ValueError where there are too few, or runs are too long."""
    if len(data) < 4:
        raise ValueError("no pixels")
    if width not in _ENCODED_WIDTHS or not (data[0] == data[1] == 2 and data[2] < 128):
        return data[:4 * width * height].reshape(height, width, 4)
    rows = np.empty((height, 4, width), np.uint8)
    place = 0
    for row in rows:
        if bytes(data[place:place + 4]) != bytes((2, 2, width >> 8, width & 255)):
            raise ValueError("no scanline")
        place += 4
        for channel in row:
            filled = 0
            while filled < width:
                count = int(data[place])
                run = count > 128
                count = count - 128 if run else count
                values = data[place + 1:place + (2 if run else 1 + count)]
                if not count or len(values) != (1 if run else count):
                    raise ValueError("an empty run")
                channel[filled:filled + count] = values[0] if run else values
                filled += count
                place += 1 + len(values)
            if filled != width:
                raise ValueError("a run beyond the row")
    return rows.transpose(0, 2, 1)
