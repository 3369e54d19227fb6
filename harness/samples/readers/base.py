"""What every reader of images returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from harness.samples.estimate import Estimate


@dataclass(frozen=True, eq=False)
class ReadImage:
    """The image of a file, (H, W, 3) float64, linear Rec.709, row 0 at the top, and what is known of it.

    `metadata`: the file's own, as far as it is text and numbers. `spp`: samples per pixel where the file says so.
    `notes`: what a reader of the numbers should know, one sentence each. `estimate`: the image with its variance where
    the file holds that, or an exact one.
    """

    pixels: np.ndarray
    metadata: Mapping[str, str | int | float] = field(default_factory=dict)
    spp: int | None = None
    notes: tuple[str, ...] = ()
    estimate: Estimate | None = None
