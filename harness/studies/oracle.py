"""The coupled oracle against Mitsuba's own `path`, with random numbers of their own: is what both sides of a coupled
verdict have in common right? Measured once, at length, and kept with its date."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

import numpy as np

from harness.errors import HarnessError
from harness.estimators.base import Estimator
from harness.estimators.coupled import Coupled
from harness.estimators.mitsuba import Mitsuba
from harness.files import data_dir
from harness.progress import Advance
from harness.samples import json
from harness.samples.store import Store
from harness.scene import SceneFile
from harness.stats.channels import Channel
from harness.stats.levels import family_level
from harness.stats.verdicts import TileVerdict, Tolerance, bias_verdict
from harness.work.run import Run

FILE = "oracle.json"
# The longer side of the image, in pixels: the fewer pixels, the more samples each, and the mean is as sharp.
SIDE = 48
# Samples per pixel of one replica: at this size some tenths of a second of CPU time. Twice as many, four times, … where
# more than so many seconds are asked for, since there are seeds for so many replicas only.
SPP, LONG = 128, 256.0
# Replicas of each side whose variance and time divide the rest between both.
FIRST = 16
# Replicas of each side at the most, for Mitsuba has seeds for 1024: of a furnace, two minutes would make more.
MOST = 1000
# What rounding may leave, relative: where light is seen directly there is no noise, and every last bit would count.
ROUNDING = 2e-6
# All tests of all scenes together raise a false alarm with this probability.
FALSE_ALARMS = 0.01


@dataclass(frozen=True)
class OracleTiles:
    """The tiles of one size: the deviate of the clearest, beyond rounding; the one that chance exceeds in one of a
    hundred such files; and the largest bias, relative, that the least sure tile could hide with probability 0.05."""

    deviate: float
    critical: float
    detectable: float


@dataclass(frozen=True)
class OracleRecord:
    """One scene, by one strategy of the oracle.

    `spp`: samples per pixel of the oracle and of `path`, at `size` (width, height). `error`: of the image's mean
    luminance, the oracle's relative to `path`'s, with its 95 % interval (error, low, high). `seconds`: CPU, of both.
    `agrees`: no test failed, of those that share the file's rate of false alarms.
    """

    scene: str
    strategy: str
    size: tuple[int, int]
    spp: tuple[int, int]
    error: tuple[float, float, float]
    mean: OracleTiles
    coarse: OracleTiles
    fine: OracleTiles
    seconds: float
    agrees: bool


@dataclass(frozen=True)
class OracleFile:
    """All that was measured, the day (UTC, ISO 8601) when the last was, and the versions of what measured."""

    date: str
    versions: dict[str, str]
    records: tuple[OracleRecord, ...]


def measure_oracle(scenes: Sequence[SceneFile], strategy: str, seconds: float, store: Store | None = None, *,
                   keep: Callable[[OracleFile], None] = lambda found: None,
                   advance: Advance = lambda n: None) -> OracleFile:
    """Draw both sides of each scene until they took so many CPU seconds or `MOST` replicas, and judge their difference.

    The seconds are divided so that the variance of the difference is smallest, which takes long runs of a side that is
    noisy, such as an oracle that meets lamps by chance alone, and short ones of a slow integrator (Neyman 1934, "On the
    two different aspects of the representative method", J. Roy. Statist. Soc. 97, with costs): the division depends on
    first replicas' variances, on no error. `store` keeps the batches and what they took, so a run that was interrupted
    goes on where it was, and a longer one adds to it, as long as its replicas are as long (`LONG`). `keep` is given all
    that was found so far after each scene.
    HarnessError for an unknown strategy or no scene, SceneError for a scene outside the oracle's reach.
    """
    if not scenes:
        raise HarnessError("there is no scene to hold the oracle against `path` on; name one or more")
    records: list[OracleRecord] = []
    for scene in scenes:
        oracle, path = _runs(sized(scene), strategy, seconds, store)
        records.append(compared(scene.name, strategy, oracle, path, len(scenes)))
        keep(_file(records))
        advance(1)
    return _file(records)


def sized(scene: SceneFile) -> SceneFile:
    """The scene at no more than `SIDE` pixels a side."""
    film = scene.film
    scale = min(1.0, SIDE / max(film.width, film.height))
    return scene.sized(*(max(1, round(scale * side)) for side in (film.width, film.height)))


def compared(scene: str, strategy: str, oracle: Run, path: Run, family: int) -> OracleRecord:
    """The record of both sides of a scene, one of so many that share the rate of false alarms."""
    verdict = bias_verdict(oracle.tiles(), path.tiles(), Tolerance(ROUNDING, ROUNDING, ROUNDING),
                           fail_level=family_level(FALSE_ALARMS, family))
    height, width = oracle.estimate().mean.shape[:2]
    seconds = sum(run.estimate().cost.seconds for run in (oracle, path))
    return OracleRecord(scene, strategy, (width, height), (oracle.estimate().samples, path.estimate().samples),
                        verdict.luminance, _tiles(verdict.mean), _tiles(verdict.coarse), _tiles(verdict.fine), seconds,
                        verdict.outcome != "fail")


def save_oracle(found: OracleFile, path: str | Path) -> None:
    """Write as JSON; StoreError where that cannot be written."""
    json.save(Path(path), found)


def load_oracle(path: str | Path) -> OracleFile:
    """The file that `save_oracle` wrote; StoreError where it is not one."""
    return json.load(Path(path), lambda held: json.built(OracleFile, held),
                     what="a comparison of the oracle with `path`", mend="run `harness oracle` again")


def oracle_file() -> Path:
    """The comparison that comes with the harness, which was made once."""
    return data_dir("reports") / FILE


def _runs(scene: SceneFile, strategy: str, seconds: float, store: Store | None) -> tuple[Run, Run]:
    """Both sides, drawn; one renderer lives at a time (see `estimators.held`)."""
    sides: tuple[Estimator, Estimator] = (Coupled(strategy), Mitsuba("path"))
    spp = SPP << max(0, math.ceil(math.log2(seconds / LONG)))
    runs, weights = [], []
    for side in sides:
        with side.open(scene) as renderer:
            run = Run(renderer, spp, store)
            run.grow(1)
            compiled = run.estimate().cost.seconds  # the first replica's time is mostly that of the compiler
            run.grow(FIRST)
            variance = float(run.estimate().luminance_variance.mean())
            weights.append(math.sqrt(variance * max(run.estimate().cost.seconds - compiled, 0.0)))
            runs.append(run)
    for run, side, weight in zip(runs, sides, weights, strict=True):
        share = weight / sum(weights) if sum(weights) > 0 else 1 / len(sides)
        with side.open(scene) as run.renderer:
            while run.estimate().cost.seconds < share * seconds and run.replicas < MOST:
                run.grow(run.replicas + 1)
    return runs[0], runs[1]


def _tiles(verdict: TileVerdict) -> OracleTiles:
    deviates = np.where(np.abs(verdict.error) > ROUNDING, np.nan_to_num(verdict.z), 0.0)
    deviate = float(deviates.flat[np.argmax(np.abs(deviates))])
    return OracleTiles(deviate, verdict.critical, float(np.max(verdict.smallest_detectable[..., Channel.LUMINANCE])))


def _file(records: Sequence[OracleRecord]) -> OracleFile:
    versions = {name: metadata.version(name) for name in ("glsl-validation-harness", "mitsuba", "drjit")}
    return OracleFile(datetime.now(UTC).date().isoformat(), versions, tuple(records))
