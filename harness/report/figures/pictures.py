"""The report's images: display-encoded renders, signed differences and FLIP maps as PNG, with their colour bars."""

from __future__ import annotations

import io
import math
from functools import cache
from importlib import metadata

import numpy as np
from PIL import Image

from harness.metrics import flip_map, signed_relative_difference
from harness.samples.images import display_pixels
from harness.samples.keys import code_digest
from harness.samples.memo import remembered_bytes

# At 41 mm printed width this is 300 dots per inch; larger images are averaged down by a whole factor.
MAX_PIXELS = 512

# Signed maps: dark blue over grey to yellow, evenly lighter all the way, so that the sign survives a printer without
# colour and any colour blindness (Nuñez et al. 2018, "Optimizing colormaps with consideration for color vision
# deficiency to enable accurate interpretation of scientific data").
DIFFERENCE_MAP = "cividis"
# What captions call its ends, and what is undefined.
DARKER, BRIGHTER, NOTHING = "dark blue", "yellow", "white"
FLIP_MAP = "magma"  # the map of FLIP's authors (Andersson et al. 2020)
UNDEFINED = np.array([255, 255, 255], dtype=np.uint8)

_LEVELS = 255  # of a colour map; the palette's last entry is for what is undefined
ROBUST_PERCENTILE = 99.0
ROBUST_WORDS = f"the {ROBUST_PERCENTILE:g}th percentile"


def shrink_factor(image: np.ndarray) -> int:
    """The whole factor by which an image (H, W, ...) is averaged down to at most `MAX_PIXELS` a side."""
    return max(1, math.ceil(int(max(image.shape[:2])) / MAX_PIXELS))


def shrink(image: np.ndarray) -> np.ndarray:
    """`image` averaged over k × k blocks, k = `shrink_factor`; the odd rows and columns at the end are cropped."""
    k = shrink_factor(image)
    if k == 1:
        return image
    height, width = image.shape[0] // k, image.shape[1] // k
    blocks = image[: height * k, : width * k].reshape(height, k, width, k, *image.shape[2:])
    return np.asarray(blocks.mean((1, 3)))


def display_png(image: np.ndarray, exposure: float) -> bytes:
    """A linear image (H, W, 3) at a fixed exposure (in stops), clipped and sRGB-encoded, as PNG."""
    return _png(Image.fromarray(display_pixels(shrink(image), exposure)))


def difference_map(test: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """(H, W) signed relative difference of luminance, averaged down where the image is large."""
    return signed_relative_difference(shrink(test), shrink(reference))


def difference_png(difference: np.ndarray, limit: float) -> bytes:
    """A signed map (H, W) in a colour map from -limit to +limit; white where it is not finite."""
    return _mapped(0.5 + 0.5 * difference / limit, DIFFERENCE_MAP)


def tile_pixels(values: np.ndarray, tile: int, height: int, width: int) -> np.ndarray:
    """Values of tiles (rows, columns) at each pixel of their image, (height, width)."""
    return values.repeat(tile, axis=0).repeat(tile, axis=1)[:height, :width]


def perceived_map(test: np.ndarray, reference: np.ndarray, exposure: float) -> np.ndarray:
    """(H, W) FLIP map at a fixed exposure, averaged down where the image is large; read back where it was made before.

    The evaluator takes a quarter of a second for an image, and a report has fifty.
    """
    def make() -> bytes:
        buffer = io.BytesIO()
        np.savez_compressed(buffer, map=shrink(flip_map(test, reference, exposure)))
        return buffer.getvalue()

    key = [code_digest(__name__), metadata.version("flip-evaluator"), test, reference, exposure]
    with np.load(io.BytesIO(remembered_bytes("figures", key, make))) as held:
        return np.asarray(held["map"])


def perceived_png(error: np.ndarray, limit: float) -> bytes:
    """A FLIP map (H, W) in its colour map from 0 to `limit`."""
    return _mapped(error / limit, FLIP_MAP)


def bar_png(name: str) -> bytes:
    """A horizontal colour bar, one pixel high, to be stretched where it is used."""
    return _mapped(np.linspace(0, 1, _LEVELS)[None, :], name)


@cache
def palette(name: str) -> bytes:
    """The colours of a map in their order, three bytes each: red, green, blue."""
    key = [_LEVELS, name, metadata.version("matplotlib")]
    return remembered_bytes("figures", key, lambda: _colours(name))


def _colours(name: str) -> bytes:
    from matplotlib import colormaps

    return bytes(colormaps[name](np.linspace(0, 1, _LEVELS), bytes=True)[:, :3].tobytes())


def robust_limit(maps: list[np.ndarray], floor: float) -> float:
    """The 99th percentile of the absolute values of all maps together, rounded up to 1, 2 or 5 times a power of ten."""
    values = np.abs(np.concatenate([m[np.isfinite(m)].ravel() for m in maps])) if maps else np.empty(0)
    limit = float(np.percentile(values, ROBUST_PERCENTILE)) if values.size else 0.0
    return round_up(max(limit, floor))


def round_up(value: float) -> float:
    """The next of 1, 2, 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(float(f"{m * power:.3g}") for m in (1, 2, 5, 10) if m * power >= value * (1 - 1e-9))


def _mapped(unit: np.ndarray, name: str) -> bytes:
    """Values (H, W) in [0, 1] through a colour map as PNG; outside saturates, not finite is white.

    A palette makes the file a third of the size that it would have with three channels.
    """
    finite = np.isfinite(unit)
    level = np.rint(np.clip(np.where(finite, unit, 0.0), 0.0, 1.0) * (_LEVELS - 1)).astype(np.uint8)
    image = Image.fromarray(np.where(finite, level, np.uint8(_LEVELS)))
    image.putpalette(palette(name) + UNDEFINED.tobytes())
    return _png(image)


def _png(image: Image.Image) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, format="PNG", compress_level=6)
    return buffer.getvalue()
