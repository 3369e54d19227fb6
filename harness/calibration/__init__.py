"""The calibration: how often the verdicts err, on pairs of estimates, and in the suite of gates as it stands."""

from __future__ import annotations

import time

from harness.calibration.comparisons import BATCHES, SIDE, compare
from harness.calibration.coupled import compare_coupled
from harness.calibration.storage import load, save
from harness.calibration.suite import simulate_suite
from harness.gates import GatesFile
from harness.progress import Progress, quiet
from harness.samples.store import Store
from harness.stats.calibration import Calibration
from harness.work.provenance import versions

__all__ = ["Calibration", "calibrate", "load", "save"]


def calibrate(family: GatesFile, comparisons: int = 300, runs: int = 1000, *, store: Store | None = None, jobs: int = 1,
              progress: Progress = quiet) -> Calibration:
    """Measure false alarms and power of verdicts on so many pairs of each case, and in so many runs of a gates file.

    The pairs are of independent estimates, and of coupled ones, that share their random numbers.
    `store` keeps the gates' references; `jobs` processes simulate the runs. HarnessError for a gate that cannot run.
    """
    began = time.perf_counter()
    suite = simulate_suite(family, runs, store=store, jobs=jobs, progress=progress)
    simulated = time.perf_counter()
    cases, alarms, powers = compare(comparisons, progress)
    also, differences, coupled = compare_coupled(comparisons, progress)
    facts = {**versions(), "comparisons of each case": str(comparisons), "image size": f"{SIDE} x {SIDE}",
             "batches of each estimate": str(BATCHES), "seconds": f"{time.perf_counter() - began:.0f}",
             "seconds of the suite's part": f"{simulated - began:.0f}"}
    return Calibration({**cases, **also}, (*alarms, *differences), powers, suite, facts, coupled)
