"""A vertex of the paths of a look: its records, what Mitsuba finds there, and what is carried along the paths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.gpu.tap import Records
from harness.reference.coupled_steps import Vertices

# What the taps note of a vertex: which functions were called.
NORMAL, ENVIRONMENT, EMISSION, SCATTER = 2, 4, 8, 16
# Rays so nearly along a surface may be taken to be on either side of it.
GRAZING = 1e-5


@dataclass
class Progress:
    """What is carried along the paths of a look, (N, ...): `state` of the generator before the next scattering, as the
    path's own recorded one leads to; `taken`, how many numbers the path took by then; `throughput` and `radiance` in
    float32 as the loop should have them."""

    state: np.ndarray
    taken: np.ndarray
    throughput: np.ndarray
    radiance: np.ndarray
    direction: np.ndarray
    lifted: np.ndarray
    met: np.ndarray
    normal: np.ndarray


@dataclass(frozen=True, eq=False)
class Vertex:
    """The records of one vertex on the paths `lanes` that reach it, and what Mitsuba finds there."""

    number: int
    lanes: np.ndarray
    seen: Records
    theirs: Vertices
    shape: np.ndarray
    called: np.ndarray

    def __getitem__(self, name: str) -> np.ndarray:
        return self.seen[name].astype(np.float64)


def begin(state: np.ndarray, taken: int) -> Progress:
    """Before the first vertex; `taken`: numbers for the film, the lens and the time."""
    count = len(state)
    nothing = np.zeros((count, 3))
    return Progress(state, np.full(count, taken), np.ones((count, 3), dtype=np.float32),
                    np.zeros((count, 3), dtype=np.float32), nothing, nothing.copy(), nothing.copy(), nothing.copy())
