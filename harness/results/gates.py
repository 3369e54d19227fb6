"""What gates found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from harness.stats.bias import Outcome
from harness.stats.channels import Channel


@dataclass(frozen=True)
class PartRecord:
    """The verdict on an image's mean, or on its tiles of `tile` pixels a side; as `stats.verdicts.TileVerdict` has it.

    `smallest_detectable`: the smallest bias that was sure to make the gate fail here. Numbers that are not finite are
    None, in all records of a gate.
    """

    outcome: Outcome
    reason: str
    tolerance: float
    tile: int
    p: float
    largest_error: float | None
    smallest_detectable: float | None


@dataclass(frozen=True)
class LookRecord:
    """What a gate saw when it looked, of the image's mean luminance, after so many samples per pixel a side."""

    samples: int
    reference_samples: int
    outcome: Outcome
    reason: str
    error: float | None
    low: float | None
    high: float | None


@dataclass(frozen=True)
class PointRecord:
    """A gate's curve at a prefix: mean error of luminance with its interval, RMSE of the smaller tiles, relative."""

    samples: int
    error: float | None
    low: float | None
    high: float | None
    tile_rmse: float | None


@dataclass(frozen=True)
class RungRecord:
    """A failed gate at a lesser depth: error of the image's mean luminance with its interval, after so many samples per
    pixel. `black`: neither side has light at that depth."""

    depth: int
    outcome: Outcome | Literal["black"]
    reason: str
    samples: int
    error: float | None
    low: float | None
    high: float | None


@dataclass(frozen=True)
class AgreementRecord:
    """Of single samples of a coupled gate, the share that differs from its twin, with its interval."""

    outcome: Outcome
    reason: str
    tolerance: float
    threshold: float
    share: float
    low: float
    high: float
    samples: int


@dataclass(frozen=True)
class GateNumbers:
    """What a gate measured. `error`, `low`, `high`: of the image's mean, per channel, at `confidence`.

    `tests`: 'mean', 'coarse' and 'fine'. `samples` per pixel were drawn of a `budget`; `not_finite` of the whole image
    were left out. `fail_level`: the gate's share of its family's false alarms. `agreement`: of a coupled gate.
    """

    error: tuple[float | None, ...]
    low: tuple[float | None, ...]
    high: tuple[float | None, ...]
    confidence: float
    tests: Mapping[str, PartRecord]
    looks: tuple[LookRecord, ...]
    curve: tuple[PointRecord, ...]
    samples: int
    budget: int
    not_finite: int
    fail_level: float
    seconds: float
    agreement: AgreementRecord | None = None

    @property
    def luminance(self) -> tuple[float | None, float | None, float | None]:
        """Error, low and high of luminance."""
        return self.error[Channel.LUMINANCE], self.low[Channel.LUMINANCE], self.high[Channel.LUMINANCE]


@dataclass(frozen=True)
class GateRecord:
    """A gate that was run, as files, tables and pages have it; `numbers` are None where it could not be run.

    `why`: the reason for its tolerance; `origin`: file and line; `command`: what runs it again. These and what comes
    between them are empty where the gate could not even be read. `ladder`: what it says at lesser depths, where it was
    asked (`gates.ladder`); `wrong_from`: the first depth at which it fails, None where that is not known. `autopsy`:
    the report of one, of a coupled gate that failed.
    """

    gate: str
    outcome: Outcome | Literal["error"]
    reason: str
    why: str = ""
    scene: str = ""
    strategy: str = ""
    origin: str = ""
    command: str = ""
    wrong_from: int | None = None
    ladder: tuple[RungRecord, ...] = ()
    autopsy: str = ""
    numbers: GateNumbers | None = None


@dataclass(frozen=True)
class GateEvidence:
    """A gate as it ran last, and what it left: the names of its `files` in a `folder`, whose path is told from where
    the results of all gates lie, with forward slashes."""

    record: GateRecord
    folder: str
    files: tuple[str, ...]
