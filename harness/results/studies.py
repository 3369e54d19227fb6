"""Results of studies, and of pairs of renderers that draw the same numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from harness.samples.estimate import Estimate
from harness.stats.bias import MeanErrorVerdict, Outcome
from harness.stats.channels import Channel
from harness.stats.convergence import Slope
from harness.stats.findings import Tiles


@dataclass(frozen=True)
class Record:
    """A row of a study's table: one number, and beside it all that it depends on.

    `scene`: the file's name; `parameters`: what was set in it by name (`SceneFile.given`). `estimator`: a
    strategy, or what else was studied. `replica`: None where the number is of all replicas together. `samples`: per
    pixel, all that went into it. `quantity`: a metric's name (see `harness.metrics`), or 'slope',
    'smallest_detectable', 'seconds_per_spp', 'rejected' (samples of the whole image), or a cost (see `studies.costs`).
    `channel`: empty where it is of all. `low`, `high`: the interval, at the confidence of the study's verdicts; None
    where there is none. `n`: how many independent replicas it stands on. `device`: what drew the samples; empty where
    several did.
    """

    scene: str
    parameters: tuple[tuple[str, str], ...]
    estimator: str
    replica: int | None
    samples: int
    quantity: str
    channel: str
    value: float
    low: float | None
    high: float | None
    n: int
    device: str


SECONDS, REJECTED = "seconds_per_spp", "rejected"


@dataclass(frozen=True, eq=False)
class StrategyResult:
    """One strategy on one scene: rows of the study's table, and what is judged from them. R replicas, P prefixes.

    `measured`: every number that was measured, see `studies.table.measured`; `spp`, `curves`, `scores`,
    `seconds_per_spp` and `device` are views of it. `estimate` merges all replicas. `suits` is False where the strategy
    cannot reach some light (then `warning` says which), and its verdict does not count against the tracer. `verdict` is
    that on the image's mean, `tiles` those on its parts.
    """

    strategy: str
    suits: bool
    warning: str
    measured: tuple[Record, ...]
    estimate: Estimate
    verdict: MeanErrorVerdict
    tiles: Tiles
    slope: Slope | None  # None where the strategy has no variance to converge from
    expected: tuple[float, ...] = (-0.5,)  # slopes that its sampler promises: of smooth pixels, edges, many numbers

    @cached_property
    def spp(self) -> np.ndarray:
        """(P,) samples per pixel of each prefix."""
        return np.array(sorted({row.samples for row in self.measured if row.replica is not None}))

    @cached_property
    def curves(self) -> Mapping[str, np.ndarray]:
        """By name each metric that is measured at prefixes, (R, P), of each replica's prefix against the reference."""
        points: dict[str, dict[int, list[tuple[int, float]]]] = {}
        for row in self.measured:
            if row.replica is not None and row.quantity != SECONDS:
                points.setdefault(row.quantity, {}).setdefault(row.replica, []).append((row.samples, row.value))
        return {name: np.array([[value for _, value in sorted(curve, key=lambda point: point[0])]
                                for _, curve in sorted(replicas.items())]) for name, replicas in points.items()}

    @cached_property
    def scores(self) -> Mapping[str, float]:
        """By name every other metric, of the merged estimate."""
        return {row.quantity: row.value for row in self.measured
                if row.replica is None and row.quantity not in (SECONDS, REJECTED)}

    @property
    def seconds_per_spp(self) -> float:
        """For one sample per pixel of the whole image, the median over batches, by the clock that counts on `device`;
        NaN where the batches come from several."""
        return next(row.value for row in self.measured if row.quantity == SECONDS and row.replica is None)

    @cached_property
    def replica_seconds(self) -> np.ndarray:
        """(R,) the same of each replica alone, NaN where it is not known."""
        found = {row.replica: row.value for row in self.measured
                 if row.quantity == SECONDS and row.replica is not None}
        drawn = sorted({row.replica for row in self.measured if row.replica is not None})
        return np.array([found.get(replica, np.nan) for replica in drawn])

    @property
    def parameters(self) -> tuple[tuple[str, str], ...]:
        """What was set in the scene, as (name, value)."""
        return self.measured[0].parameters

    @property
    def device(self) -> str:
        """What drew the samples; empty where several did."""
        return self.measured[0].device

    @property
    def outcome(self) -> Outcome:
        """fail where the mean or a tile fails; else the outcome of the mean.

        Undecided tiles leave it alone: noise that decides the mean of an image seldom decides each of its tiles.
        """
        return "fail" if self.tiles.failed else self.verdict.outcome

    def score(self, metric: str) -> float:
        """One number for a metric: of the merged estimate, or, where it has a curve, of one replica at full length, the
        mean over replicas. KeyError for an unknown name."""
        return float(self.curves[metric][:, -1].mean()) if metric in self.curves else self.scores[metric]


@dataclass(frozen=True, eq=False)
class StudyResult:
    """One scene, its reference, and every strategy that was run on it.

    `description` is the scene file's opening comment. `reference_kind`: 'Mitsuba', 'closed form',
    or 'given' where the caller brought it.
    `provenance`: flat mapping of name to value (versions, GL renderer, seeds, hashes, sizes), all strings.
    `error`: the RMSE, relative to the reference's mean luminance, at which costs are told; None: one that all reach.
    """

    scene: str
    description: str
    scene_hash: str
    exposure: float
    reference: Estimate
    reference_kind: str
    strategies: tuple[StrategyResult, ...]
    notes: tuple[str, ...] = ()
    provenance: dict[str, str] = field(default_factory=dict)
    error: float | None = None

    @property
    def cell(self) -> tuple[str, tuple[tuple[str, str], ...]]:
        """The scene file's name and what was set in it: how two studies of one thing know each other."""
        return self.strategies[0].measured[0].scene, self.strategies[0].parameters

    @property
    def brightness(self) -> float:
        """The reference's mean luminance, which relative errors are relative to."""
        return float(self.reference.image_mean[Channel.LUMINANCE])


@dataclass(frozen=True, eq=False)
class CoupledRecord:
    """How far one strategy on one scene agrees with the oracle that draws the same random numbers.

    `ratio`: the variance of a pixel over that of its difference, both averaged over the image; NaN where it has no
    noise. `error`: of the image's mean, relative, with its 95 % interval (error, low, high). Of `singles`, samples
    compared one by one, `differing` are off by over 0.1 % of themselves, of these `parting` by over 1 % of the image's
    mean. `left`: (H, W), the relative difference of each pixel. All but `singles` of luminance. `seconds`: elapsed.
    """

    scene: str
    strategy: str
    replicas: int
    spp: int
    ratio: float
    error: tuple[float, float, float]
    singles: int
    differing: int
    parting: int
    seconds: float
    left: np.ndarray
