"""Float pixels behind a row of pictures, for a medium in which a reader can look closer: half floats, deflated."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, field

import numpy as np

# The largest number that a half float holds (IEEE 754, binary16); what is larger is stored as that.
LARGEST = float(np.finfo(np.float16).max)
_LEVEL = 4  # of zlib: 6 takes twice as long for a hundredth less


@dataclass(frozen=True)
class Plane:
    """An array (H, W) or (H, W, C) as half floats: `content` is the zlib stream that `packed` makes."""

    width: int
    height: int
    channels: int
    content: bytes = field(repr=False)

    def array(self) -> np.ndarray:
        """The stored numbers, (H, W, C) float32."""
        return unpacked(self.content, (self.height, self.width, self.channels))


@dataclass(frozen=True)
class Tested:
    """An image under test and what was found of it. `image`: (H, W, 3) radiance; `difference`: (H, W), signed, relative
    to the reference, in luminance, of the images before they were rounded to half floats, whose rounding would drown a
    small one; `flip`: (H, W); `deviates`: of each of its tiles, `tile` stored pixels a side."""

    name: str
    image: Plane
    difference: Plane
    flip: Plane
    deviates: Plane
    tile: float


@dataclass(frozen=True)
class Pixels:
    """Images of one scene at one size: a `reference` (H, W, 3), linear radiance, and `tests` that are held against it.

    `exposure`: stops at which a viewer begins; the limits are those of the colour scales.
    """

    reference_name: str
    reference: Plane
    tests: tuple[Tested, ...]
    exposure: float
    difference_limit: float
    flip_limit: float
    deviate_limit: float


def plane(values: np.ndarray) -> Plane:
    """Values (H, W) or (H, W, C) as they are stored."""
    height, width = values.shape[:2]
    return Plane(width, height, math.prod(values.shape[2:]), packed(values))


def packed(values: np.ndarray) -> bytes:
    """Values (H, W[, C]) as a zlib stream: channel after channel, row after row, the upper byte of every half float
    first, then every lower one. Upper bytes, sign and exponent, are alike among neighbours and compress; lower ones are
    noise. NaN stays NaN."""
    stacked = values.reshape(*values.shape[:2], -1)
    halves = np.clip(stacked, -LARGEST, LARGEST).astype("<f2")  # clip leaves NaN alone
    pairs = np.ascontiguousarray(np.moveaxis(halves, -1, 0)).view(np.uint8).reshape(-1, 2)
    return zlib.compress(pairs[:, ::-1].T.tobytes(), _LEVEL)


def unpacked(content: bytes, shape: tuple[int, int, int]) -> np.ndarray:
    """What `packed` stored, (H, W, C) float32; ValueError for another shape."""
    height, width, channels = shape
    planes = np.frombuffer(zlib.decompress(content), np.uint8).reshape(2, -1)[::-1]
    halves = np.ascontiguousarray(planes.T).view("<f2").reshape(channels, height, width)
    return np.moveaxis(halves, 0, -1).astype(np.float32)
