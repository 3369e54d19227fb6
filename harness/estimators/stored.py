"""An image with its variance, as an estimator: what `harness reference` left."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.errors import HarnessError
from harness.estimators.exact import Exact
from harness.samples.exr import read_estimate
from harness.scene import SceneFile


@dataclass(frozen=True)
class Stored:
    """`path`: an .exr with its variance, or an exact one."""

    path: Path

    @property
    def name(self) -> str:
        """The file's."""
        return self.path.name

    def check(self, scene: SceneFile) -> str:
        """It says nothing of the scene."""
        return ""

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[Exact]:
        """HarnessError for an image of another size, without a variance, or with pixels that are not finite."""
        estimate, _ = read_estimate(self.path)
        height, width = estimate.mean.shape[:2]
        film = scene.film
        if (height, width) != (film.height, film.width):
            raise HarnessError(f"the reference {self.path.name} is {width} x {height} pixels, the gate {film.width} x "
                               f"{film.height}; set 'size'")
        if estimate.batches and np.isnan(estimate.variance).any():
            raise HarnessError(f"the reference {self.path.name} carries no variance, so nothing can be decided; write "
                               "it with `harness reference` or harness.write_estimate")
        if not np.isfinite(estimate.mean).all():
            raise HarnessError(f"{self.path}: holds pixels that are not finite; render it again")
        yield Exact(estimate, {"renderer": "file", "file": str(self.path)})
