"""PNG files ready to look at."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from harness.errors import StoreError
from harness.samples.images import NAN_COLOUR, display_pixels, write_png


def test_png_holds_srgb_code_values(tmp_path: Path) -> None:
    """Linear 0.2140 is code value 127.5 of 255, one stop up in exposure 0.4281 is 174.6; row 0 is on top."""
    image = np.zeros((2, 3, 3))
    image[0, 1] = (0.2150, 1.0, 7.0)
    write_png(tmp_path / "a.png", image)
    with Image.open(tmp_path / "a.png") as png:
        assert (png.format, png.mode, png.size) == ("PNG", "RGB", (3, 2))
        pixels = np.asarray(png)
    assert pixels[0, 1].tolist() == [128, 255, 255]
    assert np.count_nonzero(pixels) == 3
    assert display_pixels(image, 1.0)[0, 1].tolist() == [175, 255, 255]


def test_nan_is_shown_and_not_hidden() -> None:
    image = np.full((2, 2, 3), 0.5)
    image[1, 0, 2] = np.nan
    pixels = display_pixels(image)
    assert tuple(pixels[1, 0]) == NAN_COLOUR
    assert tuple(pixels[0, 0]) == (188, 188, 188)


def test_unwritable_place_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(StoreError, match="cannot be written"):
        write_png(tmp_path / "file" / "a.png", np.ones((2, 2, 3)))
