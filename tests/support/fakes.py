"""Renderers that draw from known distributions: what a test of the statistics knows the answer of."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness.samples.cost import Cost
from harness.samples.estimate import Batch
from harness.samples.traits import Traits


class NoiseRenderer:
    """Normal noise of standard deviation `sigma` per sample around `mean`, in an image of `size` (H, W).

    `mean`, `sigma`: numbers, or what numpy can stretch to the image.
    """

    traits = Traits()

    def __init__(self, mean: float | np.ndarray = 0.5, sigma: float | np.ndarray = 0.3,
                 size: tuple[int, int] = (16, 24)) -> None:
        self.mean, self.sigma, self.size = mean, sigma, size
        self.calls: list[tuple[int, int, int]] = []

    @property
    def identity(self) -> dict[str, str]:
        return {"renderer": "noise", "mean": str(self.mean), "sigma": str(self.sigma), "size": str(self.size)}

    def render_batch(self, replica: int, start: int, count: int,
                     advance: Callable[[float], None] | None = None) -> Batch:
        self.calls.append((replica, start, count))
        rng = np.random.default_rng([replica, start, count])
        image = self.mean + self.sigma / np.sqrt(count) * rng.standard_normal((*self.size, 3))
        return Batch(image.astype(np.float32), count, cost=Cost(1e-3 * count, 1e-3 * count, None, "cpu: test", "cpu"))
