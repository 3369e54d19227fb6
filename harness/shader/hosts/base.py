"""What a host is: how a shader learns which samples to draw, and where it leaves them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

# The shader numbers replicas and the samples of each by uint; beyond, streams would repeat.
SEEDS = 2**32


@dataclass(frozen=True)
class Pass:
    """One draw over the whole image: the `number`th since the sum was nothing, `samples` per pixel from `first` on."""

    number: int
    first: int
    samples: int
    replica: int


class Host(Protocol):
    """A dialect. Shaders of it are drawn pass by pass, each reading what the pass before left."""

    @property
    def name(self) -> str:
        """The word that chooses it."""
        ...

    @property
    def previous(self) -> str:
        """The sampler that holds the previous pass."""
        ...

    def uniforms(self, now: Pass) -> Mapping[str, int]:
        """What the shader is told of a pass."""
        ...

    def sums(self, pixels: np.ndarray, samples: int) -> tuple[np.ndarray, np.ndarray]:
        """What `samples` samples per pixel left, (H, W, 4) float64: their sum, (H, W, 3), and how many of them count,
        (H, W, 1)."""
        ...
