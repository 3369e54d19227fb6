"""Pictures of scenes without one of their features, or by one strategy at few samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class FeatureImage:
    """One side of what the report shows side by side: linear radiance (H, W, 3) at the size of the scene's film.

    `scene`: its name. `side`: the feature that was left out (`harness.scene.without`, or `footprint`), or a strategy.
    `samples`: per pixel.
    """

    scene: str
    side: str
    samples: int
    image: np.ndarray
