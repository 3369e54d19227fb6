"""The benchmark: tracer and Mitsuba, or tracer and tracer, interleaved in one run, by their devices' clocks."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from harness.estimators.base import Estimator, Renderer
from harness.estimators.mitsuba import Mitsuba
from harness.estimators.tracer import Tracer
from harness.gpu.device import ENTRY, WIDE
from harness.gpu.entries import ENTRIES
from harness.gpu.width import ask
from harness.progress import Progress, quiet
from harness.results import Benchmark, BenchRow, EntrantRow
from harness.samples import json
from harness.samples.estimate import Accumulator
from harness.scene import SceneFile
from harness.work.apart import Apart, ApartRenderer
from harness.work.provenance import versions

# Seconds of wall time that one measurement of one renderer should take: long against timer and launch overhead.
TARGET_SECONDS = 1.0
# Samples per pixel of the batch that finds out how many fit into that time; also the warm-up (kernels compile).
PILOT_SPP = 16
# Largest number of samples per pixel in one measurement.
MAX_SPP = 4096


@dataclass(frozen=True)
class Case:
    """One row: a scene, the tracer's strategy, what it is measured against, the target ratio.

    `opponent`: a Mitsuba integrator, or one of WITHOUT: the tracer itself without that feature of the scene. `needed`:
    the ratio of samples per second that the design asks for; `wide`: what it asks of vectors of 512 bits instead.
    `entry`: which of the tracer's two shaders is run, in a process of its own (at 512 bits no process can draw
    fragments, at others none is as fast); empty for the device's own, in this one.
    """

    scene: str
    strategy: str
    opponent: str
    needed: float
    wide: float | None = None
    entry: str = ""


# `path` samples light sources as well; `bsdf_path` is the tracer's own algorithm written as a Mitsuba integrator.
CASES = (
    *(Case(*case, entry) for case in (
        ("diffuse", "cosine", "path", 8.0, 11.0),
        ("spheres", "mixture", "path", 5.5, 7.5),
        ("diffuse", "cosine", "bsdf_path", 3.6, 5.3),
        ("spheres", "mixture", "bsdf_path", 3.6, 5.3),
        ("environment", "mixture", "path", 6.0, 8.0),
        ("displaced", "mixture", "path", 1.2, 1.8),
    ) for entry in ENTRIES),
    Case("depth_of_field", "mixture", "no lens", 0.8),
    Case("motion_blur", "mixture", "no motion", 0.8),
)


WITHOUT = {"no lens": "lens", "no motion": "motion"}


class _Lane:
    """One renderer's measurements in a case."""

    def __init__(self, renderer: Renderer | ApartRenderer, pixels: int) -> None:
        self._renderer = renderer
        self._pixels = pixels
        self._samples = Accumulator()
        self.rate: list[float] = []  # samples per second of the clock that counts, one per round
        self.wall: list[float] = []  # samples per elapsed second
        self.device = renderer.render_batch(0, 0, PILOT_SPP).cost.device
        began = time.perf_counter()
        renderer.render_batch(0, PILOT_SPP, PILOT_SPP)
        seconds = time.perf_counter() - began
        self._spp = max(1, min(MAX_SPP, round(PILOT_SPP * TARGET_SECONDS / seconds)))

    def measure(self, round_number: int) -> None:
        began = time.perf_counter()
        batch = self._renderer.render_batch(1, round_number * self._spp, self._spp)
        wall = time.perf_counter() - began
        self.rate.append(self._pixels * self._spp / batch.cost.seconds)
        self.wall.append(self._pixels * self._spp / wall)
        self._samples.add(batch)

    def efficiency(self) -> float:
        """1 / (variance of one sample, mean over pixels, x seconds of one sample)."""
        estimate = self._samples.estimate()
        return statistics.median(self.rate) / (float(estimate.variance.mean()) * estimate.samples)


def run(cases: Sequence[Case] = CASES, rounds: int = 7, progress: Progress = quiet) -> list[BenchRow]:
    """Measure each case: the two renderers in turn, `rounds` times (at least 2)."""
    rows = []
    with progress(len(cases) * rounds, "benchmark") as advance:
        for case in cases:
            rows.append(_measure(case, rounds, advance))
    return rows


def _measure(case: Case, rounds: int, advance: Callable[[float], None]) -> BenchRow:
    scene = SceneFile.bundled(case.scene)
    pixels = scene.film.width * scene.film.height
    tracing = Tracer(case.strategy)
    judged = Apart(tracing, partial(enter, case.entry)) if case.entry else tracing
    with judged.open(scene) as tracer, _opponent(case).open(scene) as opponent:
        ours, theirs = _Lane(tracer, pixels), _Lane(opponent, pixels)
        for number in range(rounds):
            ours.measure(number)
            theirs.measure(number)
            advance(1)
    ratios = [a / b for a, b in zip(ours.rate, theirs.rate, strict=True)]
    walls = [a / b for a, b in zip(ours.wall, theirs.wall, strict=True)]
    needed = case.wide if case.wide is not None and f"{WIDE} bits" in ours.device else case.needed
    return BenchRow(
        case.scene, case.strategy, case.opponent, case.entry, needed,
        tracer_rate=statistics.median(ours.rate) / 1e6, opponent_rate=statistics.median(theirs.rate) / 1e6,
        ratio=statistics.median(ratios), low=min(ratios), high=max(ratios), wall_ratio=statistics.median(walls),
        efficiency_ratio=ours.efficiency() / theirs.efficiency())


def enter(entry: str) -> None:
    """Have this process run the tracer by one of its shaders, as fast as the machine does that."""
    os.environ[ENTRY] = entry
    ask()


def _opponent(case: Case) -> Estimator:
    """What a case is measured against."""
    if case.opponent in WITHOUT:
        return Tracer(case.strategy, without=(WITHOUT[case.opponent],))
    return Mitsuba(case.opponent)


def save(found: Benchmark, path: Path) -> None:
    """Write what was found and the versions it was measured with as JSON, for the report."""
    json.save(path, {"rows": found.rows, "entrants": found.entrants, "versions": versions()})


def load(path: Path) -> Benchmark:
    """What `save` wrote; StoreError where the file is not one."""
    return json.load(path, lambda held: Benchmark(tuple(json.built(BenchRow, row) for row in held["rows"]),
                                                  tuple(json.built(EntrantRow, row) for row in held["entrants"])),
                     what="a benchmark result", mend="run `harness bench` again")
