"""What a gate is and what running it found, as plain values."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from harness.diagnosis.record import AutopsyRecord
from harness.errors import HarnessError
from harness.estimators.base import Estimator
from harness.samples.estimate import Estimate
from harness.scene import SceneFile
from harness.stats.agreement import AgreementVerdict
from harness.stats.bias import Outcome
from harness.stats.channels import Channel
from harness.stats.levels import Looks, family_level
from harness.stats.paired import PairedLooking
from harness.stats.sequential import Looking
from harness.stats.verdicts import BiasVerdict, TileVerdict, Tolerance

# Looks are at 1/4, 1/2 and all of the budget: an easy gate is spared three quarters of it.
LOOK_SHARES = (4, 2, 1)
# Replicas at the first look: from fewer, skewness is guesswork and intervals are half as wide again (stats.tiles).
MIN_FIRST_LOOK = 16
MIN_REPLICAS = MIN_FIRST_LOOK * LOOK_SHARES[0]
# A look at the first replicas of a shared reference must find each by itself (stats.tiles.MAX_BATCHES).
MAX_REPLICAS = 256
# By how much `--tight` narrows the tolerances of coupled gates: from 2e-5 of the mean to 5e-6.
TIGHTER = 4
# Pixels a side: no verdict gains by more, and the batches of such an image still fit into 2 GB.
MAX_SIDE = 1024
# A tolerance of tiles beyond 1 sees nothing but fireflies: for gates that mean the mean alone.
MAX_TILE = 10.0


@dataclass(frozen=True)
class Gate:
    """One estimator of a scene must equal another, within a tolerance, for a reason.

    `test` is judged, `reference` is what it is held against; `reference_spp`: samples per pixel of the reference for
    each replica of the test, where it is drawn. `spp` is of each replica and `replicas` the most that may be drawn:
    together the budget. `not_finite`: the share of samples that may be neither finite nor counted. `fail_level` and
    `pass_level` are those of `stats.sequential.Looking`, the former this gate's share of its family's. `origin`: file
    and line, where messages point; `entry`: the name of the entry of the file, which stands for one gate a strategy.
    `at_once`: all replicas are there from the beginning (images in files), so there is one look, at all of them.
    `agreement`: of a gate whose reference draws the test's own random numbers (a *coupled* gate), the share of samples
    that may differ, None of others.
    """

    name: str
    scene: SceneFile
    test: Estimator
    reason: str
    reference: Estimator
    reference_spp: int
    tolerance: Tolerance
    spp: int
    replicas: int
    fail_level: float
    pass_level: float
    entry: str
    origin: str
    not_finite: float = 0.0
    at_once: bool = False
    agreement: float | None = None

    @property
    def strategy(self) -> str:
        """What is judged, in a word."""
        return self.test.name

    @property
    def looks(self) -> tuple[int, ...]:
        """The numbers of replicas at which the gate looks."""
        return (self.replicas,) if self.at_once else tuple(self.replicas // share for share in LOOK_SHARES)

    @property
    def plan(self) -> Looks:
        """The looks in samples per pixel."""
        return Looks(tuple(self.spp * replicas for replicas in self.looks))

    @property
    def sequence(self) -> Looking:
        """The verdicts at these looks, and the error rates that they share."""
        return Looking(self.plan, self.tolerance, self.fail_level, self.pass_level)

    @property
    def paired(self) -> PairedLooking | None:
        """The same of a coupled gate, None of another; half of its false alarms are left to the agreement."""
        if self.agreement is None:
            return None
        return PairedLooking(self.plan, self.tolerance, self.half_level, self.pass_level)

    def tightened(self) -> Gate:
        """A coupled gate with a quarter of its tolerances and four times its samples: what a sample that has not come
        yet may hide falls with their number."""
        tolerance = Tolerance(*(allowed / TIGHTER for allowed in self.tolerance.sizes))
        spp = self.spp * TIGHTER
        return replace(self, tolerance=tolerance, spp=spp, reference_spp=spp)

    @property
    def half_level(self) -> float:
        """What each of two tests may spend of the false alarms."""
        return family_level(self.fail_level, 2)

    def error(self, message: str) -> HarnessError:
        """A HarnessError that begins with where the gate stands and which it is."""
        return HarnessError(f"{self.origin}: gate '{self.name}': {message}")


@dataclass(frozen=True)
class GatesFile:
    """All gates of one file: a family, which raises a false alarm with probability `false_alarms` at the most."""

    path: Path
    gates: tuple[Gate, ...]
    false_alarms: float

    def select(self, names: list[str]) -> tuple[Gate, ...]:
        """The gates of these names, or of entries of these names; HarnessError for a name that is neither."""
        for name in names:
            if not any(name in (gate.name, gate.entry) for gate in self.gates):
                known = ", ".join(gate.name for gate in self.gates)
                raise HarnessError(f"{self.path}: no gate is called '{name}'; choose from {known}")
        return tuple(gate for gate in self.gates if not names or gate.name in names or gate.entry in names)


@dataclass(frozen=True, eq=False)
class Look:
    """One look: samples per pixel of test and reference so far, and the verdict on them."""

    samples: int
    reference_samples: int
    verdict: BiasVerdict


@dataclass(frozen=True)
class CurvePoint:
    """The first samples of a run against the whole reference.

    `error`: of the mean luminance, relative; `low`, `high`: its interval at the gate's confidence, NaN for a single
    replica; `tile_rmse`: root of the mean squared relative error of the smaller tiles' luminance, the reference's noise
    taken off.
    """

    samples: int
    error: float
    low: float
    high: float
    tile_rmse: float


@dataclass(frozen=True, eq=False)
class Rung:
    """A failed gate at another depth. `black`: neither side has light yet, so there is no mean to err from.

    `samples` per pixel were drawn; `error`, `low`, `high`: of the image's mean luminance, as of `CurvePoint`, NaN where
    none was measured. `result`: what running it found, None where it was black or could not be run.
    """

    depth: int
    outcome: Outcome | Literal["black"]
    reason: str
    samples: int
    error: float = math.nan
    low: float = math.nan
    high: float = math.nan
    result: GateResult | None = None


@dataclass(frozen=True, eq=False)
class Ladder:
    """The depths at which a failed gate was run again, in ascending order; see `gates.ladder.climb`.

    `top`: the scene's own depth, None where it has no bound; `reason`: why there are no rungs, where there is one.
    """

    rungs: tuple[Rung, ...]
    top: int | None
    reason: str = ""

    @property
    def wrong(self) -> Rung | None:
        """The first that fails; None where only the scene's own depth does."""
        return next((rung for rung in self.rungs if rung.outcome == "fail"), None)


@dataclass(frozen=True, eq=False)
class GateResult:
    """What running a gate found.

    `outcome` and `reason` are those of the last look, or of samples that were not finite. A pass means that the error
    of the image and of every tile lies within its tolerance at the gate's confidence, so a bias as large as a tolerance
    passes with probability `pass_level` / 2 at the most: a gate that cannot see so far does not pass.
    `seconds` is wall time, the reference included. `ladder`: of a gate that failed, unless it was not asked for.
    `agreement`: of a coupled gate; `autopsy`: of one that failed.
    """

    gate: Gate
    outcome: Outcome
    reason: str
    looks: tuple[Look, ...]
    curve: tuple[CurvePoint, ...]
    test: Estimate
    reference: Estimate
    exposure: float
    seconds: float
    ladder: Ladder | None = None
    agreement: AgreementVerdict | None = None
    autopsy: AutopsyRecord | None = None

    @property
    def verdict(self) -> BiasVerdict:
        """The verdict at the last look."""
        return self.looks[-1].verdict

    @property
    def smallest_detectable(self) -> dict[str, float]:
        """The smallest bias that was sure (probability 0.95) to make this gate fail: of the image's mean luminance,
        and in the larger and the smaller tile where it is hardest to see."""
        return {"mean": _detectable(self.verdict.mean), "coarse": _detectable(self.verdict.coarse),
                "fine": _detectable(self.verdict.fine)}


def _detectable(verdict: TileVerdict) -> float:
    return verdict.tolerance + float(np.max(verdict.smallest_detectable[..., Channel.LUMINANCE]))
