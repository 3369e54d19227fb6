"""One colour for all pixels, as an estimator: the closed form of a furnace."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from harness.estimators.exact import Exact
from harness.samples.estimate import Estimate
from harness.scene import SceneFile


@dataclass(frozen=True)
class Constant:
    """`rgb`: linear Rec.709 radiance."""

    rgb: tuple[float, float, float]

    @property
    def name(self) -> str:
        """`constant`."""
        return "constant"

    def check(self, scene: SceneFile) -> str:
        """It says nothing of the scene."""
        return ""

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[Exact]:
        """An image of the size of the scene's film."""
        film = scene.film
        image = np.broadcast_to(np.array(self.rgb), (film.height, film.width, 3)).copy()
        identity: Mapping[str, str] = {"renderer": "constant", "rgb": str(self.rgb)}
        yield Exact(Estimate.exact(image), identity)
