"""A closed form that is the same for all pixels: a furnace, an empty sky."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from harness.errors import HarnessError
from harness.estimators.film import film_size
from harness.progress import Advance
from harness.samples.estimate import Batch, Estimate
from harness.samples.traits import Traits
from harness.scene.file import SceneFile


@dataclass(frozen=True)
class Constant:
    """Linear Rec.709 radiance, exact."""

    rgb: tuple[float, float, float]

    def __post_init__(self) -> None:
        if len(self.rgb) != 3 or not all(np.isfinite(value) and value >= 0 for value in self.rgb):
            raise HarnessError(f"a constant is [red, green, blue], each zero or more, found {list(self.rgb)}")

    @property
    def name(self) -> str:
        """Its three values."""
        return f"constant {', '.join(f'{value:g}' for value in self.rgb)}"

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[ExactImage]:
        """The constant at the size of the scene's film."""
        width, height = film_size(scene)
        yield ExactImage(np.broadcast_to(np.array(self.rgb, dtype=np.float64), (height, width, 3)).copy())


class ExactImage:
    """An image (H, W, 3) without noise: all there from the beginning."""

    def __init__(self, image: np.ndarray) -> None:
        self.image = image
        self.traits = Traits(counts=False, fixed=Estimate.exact(image))

    @property
    def identity(self) -> dict[str, str]:
        """Its first pixel and its size."""
        height, width = self.image.shape[:2]
        return {"renderer": "constant", "rgb": str(self.image[0, 0].tolist()), "size": f"{width}x{height}"}

    def render_batch(self, replica: int, start: int, count: int, advance: Advance | None = None) -> Batch:
        """The same image for any range."""
        if advance is not None:
            advance(count)
        return Batch(self.image.astype(np.float32), count)
