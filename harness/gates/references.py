"""What gates are held against, shared by gates of one scene."""

from __future__ import annotations

from types import TracebackType

import numpy as np

from harness.errors import HarnessError, MachineError
from harness.estimators.base import Estimator
from harness.estimators.held import OneAtATime
from harness.gates.model import Gate
from harness.samples.store import Store
from harness.scene import SceneFile
from harness.work.run import FixedRun, Run, run_of


class References:
    """The references of a run of several gates: the same one of the same scene at the same size is rendered once.

    Holds what was drawn of each, but only one renderer, that of the last gate: with 14 of Mitsuba's scenes held,
    rendering a first look of each took 36 s of CPU time in place of 14. `store`: where their batches are kept, and
    looked for, between runs. Usable as it is, or in a `with` that closes the last renderer.
    """

    def __init__(self, store: Store | None = None) -> None:
        self._store = store
        self._held = OneAtATime()
        self._runs: dict[tuple[Estimator, SceneFile, int], Run | FixedRun] = {}

    def __enter__(self) -> References:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close the renderer that is open; what was drawn is kept, and more can be."""
        self._held.close()

    def of(self, gate: Gate) -> Run | FixedRun:
        """The reference of a gate. HarnessError where it cannot be had, or does not fit the scene."""
        key = gate.reference, gate.scene, gate.reference_spp
        if key not in self._runs:
            try:
                renderer = self._held.of(gate.reference, gate.scene)
            except MachineError:
                raise
            except HarnessError as error:
                raise gate.error(str(error)) if type(error) is HarnessError else error from None
            run = run_of(renderer, gate.reference_spp, self._store)
            if problem := _unusable(gate, run):
                raise gate.error(problem)
            self._runs[key] = run
        return self._runs[key]


def _unusable(gate: Gate, run: Run | FixedRun) -> str:
    """Why nothing can be held against a reference; empty where it can."""
    if isinstance(run, Run):
        alone = run.renderer.traits.replicas == 1
    else:
        estimate = run.estimate()
        if not np.isfinite(estimate.mean).all():
            return f"the reference {gate.reference.name} holds pixels that are not finite; render it again"
        alone = estimate.batches > 0 and bool(np.isnan(estimate.variance).any())
    return (f"the reference {gate.reference.name} carries no variance, so nothing can be decided; write it with "
            "`harness reference` or harness.write_estimate") if alone else ""
