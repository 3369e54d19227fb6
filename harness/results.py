"""What studies, exhibits, benchmarks and mutants found, as plain values: read by `report` and the command line."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from harness.samples.estimate import Estimate
from harness.stats.bias import MeanErrorVerdict, Outcome
from harness.stats.convergence import Slope
from harness.stats.findings import Tiles


@dataclass(frozen=True, eq=False)
class StrategyResult:
    """One strategy on one scene. R replicas, P prefixes of each run.

    `spp`: (P,) samples per pixel of each prefix. `rmse`, `mean_error`, `ssim`: (R, P), of each replica's prefix
    against the reference; `rmse` in scene radiance units with the reference's own variance subtracted,
    `mean_error` signed, of luminance, relative to the reference's mean. `estimate` merges all replicas.
    `flip`, `delta_e`: the mean of FLIP and of CIE ΔE2000 for that merged estimate. `cpu_seconds_per_spp`: process
    CPU time for one sample per pixel of the whole image, the median over batches. `suits` is False where the
    strategy cannot reach some light (then `warning` says which), and its verdict does not count against the tracer.
    `verdict` is that on the image's mean, `tiles` those on its parts.
    """

    strategy: str
    suits: bool
    warning: str
    spp: np.ndarray
    rmse: np.ndarray
    mean_error: np.ndarray
    ssim: np.ndarray
    estimate: Estimate
    verdict: MeanErrorVerdict
    tiles: Tiles
    slope: Slope | None  # None where the strategy has no variance to converge from
    flip: float
    delta_e: float
    cpu_seconds_per_spp: float

    @property
    def outcome(self) -> Outcome:
        """fail where the mean or a tile fails; else the outcome of the mean.

        Undecided tiles leave it alone: noise that decides the mean of an image seldom decides each of its tiles.
        """
        return "fail" if self.tiles.failed else self.verdict.outcome


@dataclass(frozen=True, eq=False)
class StudyResult:
    """One scene, its reference, and every strategy that was run on it.

    `description` is the scene file's opening comment. `reference_kind`: 'Mitsuba', 'closed form',
    or 'given' where the caller brought it.
    `provenance`: flat mapping of name to value (versions, GL renderer, seeds, hashes, sizes), all strings.
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


@dataclass(frozen=True)
class Finding:
    """One named check of an exhibit: the same quantity of the handout's formula and of the library's.

    `unit` says how to print the two: 'share' a fraction as a percentage, 'error' one with its sign, 'count' a whole
    number, 'number' any other, 'words' text. `caught`: the check objects to the handout's; `cleared`: it passes ours.
    """

    check: str
    measures: str
    handout: float | str
    ours: float | str
    unit: Literal["share", "error", "count", "number", "words"]
    caught: bool
    cleared: bool


@dataclass(frozen=True, eq=False)
class ExhibitImage:
    """A picture: linear radiance (H, W, 3), or a signed map (H, W) of relative differences or standard deviations."""

    title: str
    image: np.ndarray
    unit: Literal["radiance", "relative", "deviations"] = "radiance"


@dataclass(frozen=True, eq=False)
class Series:
    """One line of a plot, (N,) both; `ours` tells the library's from the handout's."""

    name: str
    ours: bool
    x: np.ndarray
    y: np.ndarray


@dataclass(frozen=True, eq=False)
class Plot:
    """Series over common axes; `log` names the axes that are logarithmic: '', 'x', 'y' or 'xy'."""

    title: str
    x_label: str
    log: Literal["", "x", "y", "xy"]
    series: tuple[Series, ...]


@dataclass(frozen=True, eq=False)
class Exhibit:
    """An error of the handout: its formula and the right one as GLSL, what it does, and what finds it.

    `file`: where its text stands under glsl/, empty for an error of wording. `size`: how large the effect is, in a few
    words; `effect` and `advice`: sentences.
    `message`: what the compiler says of it, if it does not compile.
    """

    id: str
    title: str
    file: str
    handout: str
    right: str
    size: str
    effect: str
    advice: str
    findings: tuple[Finding, ...]
    images: tuple[ExhibitImage, ...] = ()
    plots: tuple[Plot, ...] = ()
    message: str = ""


@dataclass(frozen=True)
class BenchRow:
    """A measured case of `harness bench`. Rates in million samples (paths) per CPU second, medians over the rounds.

    `ratio`: tracer's rate over the opponent's, the median of the rounds' own ratios, `low` and `high` their extremes.
    `wall_ratio`: the same by elapsed time. `efficiency_ratio`: of 1 / (variance x CPU time), so it also counts how
    noisy a sample is: how much faster the tracer reaches the same error.
    """

    scene: str
    strategy: str
    opponent: str
    needed: float
    tracer_rate: float
    opponent_rate: float
    ratio: float
    low: float
    high: float
    wall_ratio: float
    efficiency_ratio: float


@dataclass(frozen=True)
class MutantRecord:
    """A seeded bug, and what each gate said of it: killed, survived, untouched or not run, by the gate's name.

    `topic`, `file`: the part and the file of the shader; `imitates`, `origin`: what defect it is, and where that was
    seen; `killer`: the gate that should notice it.
    """

    id: str
    topic: str
    file: str
    imitates: str
    origin: str
    killer: str
    states: dict[str, str]


@dataclass(frozen=True)
class KillRecord:
    """What `harness mutants` found. By name: `survivors`, mutants that no gate noticed; `missed`, those that the gate
    which the catalogue names did not kill; `idle`, gates that ran and killed nothing."""

    gates: tuple[str, ...]
    mutants: tuple[MutantRecord, ...]
    survivors: tuple[str, ...]
    idle: tuple[str, ...]
    missed: tuple[str, ...]
