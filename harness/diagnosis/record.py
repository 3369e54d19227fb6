"""What an autopsy found, as plain values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Place:
    """A function, its file, and the line in it that computes a stage, with its text."""

    function: str
    file: str
    line: int
    text: str


@dataclass(frozen=True)
class StageRecord:
    """One question: how often it was asked, how often the answers differ, and of how many paths it is the first that
    differs; the largest difference in its measure, and what is rounding."""

    stage: str
    asks: str
    asked: int
    differs: int
    first: int
    largest: float
    measure: str
    tolerance: float


@dataclass(frozen=True)
class Row:
    """A line of the table of one path: a stage at a vertex, the shader's numbers and what they should be."""

    stage: str
    vertex: int
    shader: tuple[float, ...]
    expected: tuple[float, ...]
    differs: bool


@dataclass(frozen=True)
class Where:
    """Where in the image paths differ, pixels from the top left: the box (left, top, right, bottom), inclusive; the
    pixel with the largest share of its paths; that share; how many pixels; a coarse map of shares, row 0 at the top."""

    box: tuple[int, int, int, int]
    pixel: tuple[int, int]
    share: float
    pixels: int
    map: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class ShiftRecord:
    """A common relative difference of a stage's answers on one shape, with its standard error."""

    shape: int
    name: str
    median: float
    error: float


@dataclass(frozen=True)
class ScatterRecord:
    """The test of a sampler of one's own: paths, the largest deviation of a cell in standard errors, the whole relative
    difference and its standard error, and whether it fails."""

    vertices: int
    largest: float
    difference: float
    error: float
    fails: bool


@dataclass(frozen=True)
class AutopsyRecord:
    """What an autopsy found of a scene, a strategy and a library.

    `stage`: the first that differs, None where none does; `places`: the functions that compute it, likeliest first.
    `vertices`: how many paths it parts first at each vertex. `notes`: what was asked otherwise, and why.
    """

    scene: str
    strategy: str
    size: tuple[int, int]
    samples: int
    paths: int
    stage: str | None
    places: tuple[Place, ...]
    vertices: Mapping[int, int]
    where: Where | None
    shift: ShiftRecord | None
    stages: tuple[StageRecord, ...]
    path: tuple[Row, ...]
    scatter: ScatterRecord | None
    notes: tuple[str, ...]

    @property
    def differs(self) -> bool:
        """Whether anything was found."""
        return self.stage is not None
