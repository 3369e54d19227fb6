"""Makes the images beside it: run with the project's Python and any working folder, no arguments.

    sky.exr     128 x 64, radiance: a blue sky over brown ground, with a sun 40° up that is soft enough for sampling
                that does not know where it is
    tiles.png   64 x 64, sRGB: glazed tiles, no two rows or columns alike, so that a flip or a turn is seen
    leaves.png  64 x 64, sRGB: a pattern for reflectances that are 0 in places
    wear.png    32 x 32, grey, meant to be read `raw`: 0 to 1, for exponents and masks
    window.exr  32 x 32, radiance: four panes of different colours
    day_night.exr  16 x 12, radiance: a sky whose first column is day and whose last is night
    sun.exr     128 x 64, radiance: a clear sky over dark ground, and in one texel a sun that gives most of the light
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from harness.machine.mitsuba_runtime import import_mitsuba

FOLDER = Path(__file__).parent
SEED = 20260101


def main() -> None:
    """Write all images."""
    mi = import_mitsuba()
    for name, pixels in (("sky.exr", sky()), ("tiles.png", tiles()), ("leaves.png", leaves()), ("wear.png", wear()),
                         ("window.exr", window()), ("day_night.exr", day_night()), ("sun.exr", sun())):
        mi.Bitmap(np.ascontiguousarray(pixels)).write(str(FOLDER / name))


def sky() -> np.ndarray:
    """(64, 128, 3) float32; columns run around the y axis from -z towards +x, rows 0 and 63 lie on the poles."""
    height, width = 64, 128
    phi = (np.arange(width) + 0.5) / width * 2 * np.pi
    theta = np.arange(height)[:, None] / (height - 1) * np.pi
    d = np.stack([np.sin(phi) * np.sin(theta), np.cos(theta) + 0 * phi, -np.cos(phi) * np.sin(theta)], axis=-1)
    up = d[..., 1, None]
    zenith, horizon, ground = np.array([0.22, 0.42, 0.85]), np.array([0.75, 0.8, 0.85]), np.array([0.28, 0.2, 0.13])
    above = horizon + (zenith - horizon) * np.clip(up, 0, 1) ** 0.5
    radiance = above + (ground - above) / (1 + np.exp(up / 0.03))
    clouds = np.sin(3 * phi + 2 * np.sin(5 * theta)) * np.sin(4 * theta) ** 2
    radiance = radiance * (1 + 0.25 * clouds[..., None])
    elevation, azimuth = np.radians(40), np.radians(70)
    sun = np.array([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), -np.cos(azimuth) * np.cos(elevation)])
    spread = np.radians(9)
    glow = np.exp((d @ sun - 1) / spread**2)[..., None]
    return (radiance + 14 * np.array([1.0, 0.9, 0.7]) * glow).astype(np.float32)


def tiles() -> np.ndarray:
    """(64, 64, 3) uint8: 8 x 8 tiles with joints, hue along the rows, lightness along the columns."""
    random = np.random.default_rng(SEED)
    row, column = np.mgrid[0:8, 0:8] / 7
    color = np.stack([0.9 - 0.6 * column, 0.35 + 0.45 * row, 0.25 + 0.6 * column * (1 - row)], axis=-1)
    color *= random.uniform(0.8, 1.1, (8, 8, 1))
    image = np.kron(color, np.ones((8, 8, 1)))
    image[::8] = image[:, ::8] = 0.15
    image[2:7, 2:4] = 0.95  # a mark near one corner
    return (255 * np.clip(image, 0, 1)).round().astype(np.uint8)


def leaves() -> np.ndarray:
    """(64, 64, 3) uint8: green blades that end in pure black."""
    y, x = (np.mgrid[0:64, 0:64] + 0.5) / 64
    blade = np.clip(np.sin(2 * np.pi * (4 * x + 0.6 * np.sin(2 * np.pi * y))) * np.sin(6 * np.pi * y) * 1.6, 0, 1)
    color = blade[..., None] * np.array([0.45, 0.85, 0.25]) * (0.6 + 0.4 * x[..., None])
    return (255 * color).round().astype(np.uint8)


def wear() -> np.ndarray:
    """(32, 32, 1) uint8: scratches over a ramp."""
    y, x = np.mgrid[0:32, 0:32] / 31
    value = 0.15 + 0.7 * x + 0.3 * (np.sin(40 * (x + 0.3 * y)) > 0.8)
    return (255 * np.clip(value, 0, 1)).round().astype(np.uint8)[..., None]


def window() -> np.ndarray:
    """(32, 32, 3) float32: warm above, cold below, dark bars between."""
    image = np.zeros((32, 32, 3), dtype=np.float32)
    panes = ((4.0, 3.0, 1.5), (5.0, 2.0, 1.0), (1.0, 2.0, 4.0), (2.0, 3.5, 3.0))
    for pane, (top, left) in zip(panes, ((2, 2), (2, 17), (17, 2), (17, 17)), strict=True):
        image[top:top + 13, left:left + 13] = pane
    return image


def day_night() -> np.ndarray:
    """(12, 16, 3) float32: dims from the first column, east of -z, to the last, west of it; darker below."""
    day, night = np.array([1.6, 1.5, 1.2]), np.array([0.06, 0.08, 0.16])
    gone = (np.arange(16)[:, None] / 15) ** 0.5
    height = np.linspace(1.0, 0.5, 12)[:, None, None]
    return (height * (day + (night - day) * gone)).astype(np.float32)


def sun() -> np.ndarray:
    """(64, 128, 3) float32; the sun is one texel 33° up, 2.8° wide at half its height, in 2e-3 steradians.

    Radiances are multiples of 1/256, so that the file is small.
    """
    height, width = 64, 128
    up = np.cos(np.arange(height) / (height - 1) * np.pi)[:, None, None]
    zenith, horizon, ground = np.array([0.12, 0.25, 0.6]), np.array([0.55, 0.6, 0.65]), np.array([0.1, 0.09, 0.07])
    rows = np.where(up > 0, horizon + (zenith - horizon) * np.clip(up, 0, 1) ** 0.4, ground)
    image = np.repeat(np.round(rows * 256) / 256, width, axis=1).astype(np.float32)
    image[20, 45] = (3000, 2700, 2200)
    return image


if __name__ == "__main__":
    main()
