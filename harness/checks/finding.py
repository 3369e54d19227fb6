"""What a check found: a number beside the one it should be, the verdict, a sentence, and a picture of what failed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.samples.images import write_png

# A function that is right fails a statistical check less often than this, with other random numbers.
LEVEL = 1e-6
# Deviations are shown up to so many standard deviations, and cells as squares of so many pixels.
SHOWN, CELL = 6.0, 8


def shared_level(level: float, tests: int) -> float:
    """The level of each of so many independent tests that together are to fail at `level` (Šidák's correction)."""
    return float(-np.expm1(np.log1p(-level) / tests))


@dataclass(frozen=True, eq=False)
class Histogram:
    """Counts of samples in cells of a domain beside what the pdf says: both (R, C), rows along the domain's second
    coordinate; `centers`: the middle of each cell, (R, C, 3)."""

    observed: np.ndarray
    expected: np.ndarray
    centers: np.ndarray

    @property
    def deviations(self) -> np.ndarray:
        """(R, C), in standard deviations of a count; at least one sample counts as expected everywhere."""
        return np.asarray((self.observed - self.expected) / np.sqrt(np.maximum(self.expected, 1)))

    @property
    def worst(self) -> str:
        """The cell that deviates most, in words."""
        row, column = np.unravel_index(np.abs(self.deviations).argmax(), self.deviations.shape)
        center = ", ".join(f"{value:.2f}" for value in self.centers[row, column])
        return (f"the worst cell, about ({center}), holds {self.observed[row, column]:,.0f} where "
                f"{self.expected[row, column]:,.1f} are expected")

    def write(self, path: str | Path) -> None:
        """Write the deviations as a PNG: red where there are too many samples, blue where there are too few."""
        share = np.clip(self.deviations / SHOWN, -1, 1)
        picture = np.stack([1 + np.minimum(share, 0), 1 - np.abs(share), 1 - np.maximum(share, 0)], axis=-1)
        write_png(path, np.kron(picture, np.ones((CELL, CELL, 1))))


@dataclass(frozen=True, eq=False)
class Finding:
    """One check of one component.

    `value` is what was measured and `expected` what it should be. A statistical check has `p`, the chance of a value so
    far out where all is right; any other has `error`, how far `value` may be off. `histogram` is there where samples
    were counted.
    """

    check: str
    value: float
    expected: float
    passed: bool
    sentence: str
    p: float | None = None
    error: float | None = None
    histogram: Histogram | None = None
    function: str = ""
    where: str = ""
