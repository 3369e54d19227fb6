"""What studies, gates, exhibits, benchmarks and mutants found, as plain values: read by `report` and the commands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

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
    'smallest_detectable', 'seconds_per_spp', 'rejected' (samples of the whole image). `channel`: empty where it is of
    all. `low`, `high`: the interval, at the confidence of the study's verdicts; None where there is none. `n`: how many
    independent replicas it stands on. `device`: what drew the samples; empty where several did.
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

    @cached_property
    def spp(self) -> np.ndarray:
        """(P,) samples per pixel of each prefix."""
        return np.array(sorted({row.samples for row in self.measured if row.replica is not None}))

    @cached_property
    def curves(self) -> Mapping[str, np.ndarray]:
        """By name each metric that is measured at prefixes, (R, P), of each replica's prefix against the reference."""
        points: dict[str, dict[int, list[tuple[int, float]]]] = {}
        for row in self.measured:
            if row.replica is not None:
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
        return next(row.value for row in self.measured if row.quantity == SECONDS)

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
    """A measured case of `harness bench`. Rates in million samples (paths) per second, medians over the rounds, by the
    clock that counts on the device (`samples.cost.Cost.seconds`).

    `ratio`: tracer's rate over the opponent's, the median of the rounds' own ratios, `low` and `high` their extremes.
    `wall_ratio`: the same by elapsed time. `efficiency_ratio`: of 1 / (variance x time), so it also counts how noisy a
    sample is: how much faster the tracer reaches the same error.
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


# missed: records of a scene change, but no stage is accused. unreached: no record of any scene changes.
AutopsyOutcome = Literal["named", "misnamed", "missed", "unreached"]


@dataclass(frozen=True)
class NamedMutant:
    """An autopsy of a mutant. `wrong`: functions that its line is in, or that use what it defines; `named`: first."""

    id: str
    topic: str
    file: str
    wrong: tuple[str, ...]
    outcome: AutopsyOutcome
    scene: str = ""
    strategy: str = ""
    stage: str = ""
    named: tuple[str, ...] = ()
    place: str = ""
    share: float = 0.0
    seconds: float = 0.0


@dataclass(frozen=True)
class Acquitted:
    """What the autopsy says of a shader that is right, on one scene: the stage that it accuses, empty if none."""

    id: str
    scene: str
    strategy: str
    stage: str
    own: tuple[str, ...]


@dataclass(frozen=True)
class AutopsyScore:
    """What `harness mutants --autopsy` found."""

    mutants: tuple[NamedMutant, ...]
    variants: tuple[Acquitted, ...]

    def count(self, outcome: AutopsyOutcome) -> int:
        """How many mutants have this outcome."""
        return sum(mutant.outcome == outcome for mutant in self.mutants)

    @property
    def reached(self) -> int:
        """Mutants that change a record of some scene."""
        return len(self.mutants) - self.count("unreached")

    @property
    def accused(self) -> tuple[Acquitted, ...]:
        """Right shaders that are accused all the same."""
        return tuple(variant for variant in self.variants if variant.stage)


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
