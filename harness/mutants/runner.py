"""Runs mutants against gates: which gate notices which defect."""

from __future__ import annotations

import contextlib
import io
import json
import multiprocessing
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from harness.errors import HarnessError, ShaderError
from harness.estimate import Batch
from harness.files import data_dir, shaders_from, write_atomically
from harness.gates import Gate, References, load_gates
from harness.gates.references import Run
from harness.gates.runner import check_gate, run_gate, tracer
from harness.mutants.catalogue import Mutant, mutated_shaders
from harness.runs import Progress, quiet
from harness.stats import sequential
from harness.stats.levels import Looks
from harness.stats.tiles import tile_size
from harness.store import Store
from harness.tracer.context import Program
from harness.tracer.source import assemble

# What a gate says of a mutant. killed: it does not pass; untouched: the pixels of a first batch are the same bits, so
# the gate's scene has no use for the defect; not run: a test module that no mutant of this file is meant for.
State = Literal["killed", "survived", "untouched", "not run"]

# Files of tests whose names begin so are gates as well: what probes say of one function of the shader library.
MODULE_PREFIX = "test_"
MODULES_FOLDER = "tracer"
# pytest's status where the tests ran and one failed, and where all passed.
TESTS_FAILED, TESTS_PASSED = 1, 0


@dataclass(frozen=True)
class Gates:
    """All gates of a run: those of a file, by name, and the test modules of a folder of tests."""

    file: Path
    modules: tuple[Path, ...]
    names: tuple[str, ...]

    @classmethod
    def of(cls, file: Path, tests: Path) -> Gates:
        """HarnessError for a malformed gates file, or a folder without test modules."""
        family = load_gates(file)
        modules = tuple(sorted((tests / MODULES_FOLDER).glob(f"{MODULE_PREFIX}*.py")))
        if not modules:
            raise HarnessError(f"{tests / MODULES_FOLDER}: no test modules there; name the folder of the harness's "
                               "tests")
        return cls(file, modules, (*(gate.name for gate in family.gates), *(module.stem for module in modules)))


@dataclass(frozen=True)
class KillMatrix:
    """What each gate said of each mutant; `cells` holds one row of states per mutant, one state per gate."""

    mutants: tuple[Mutant, ...]
    gates: tuple[str, ...]
    cells: tuple[tuple[State, ...], ...]

    @property
    def survivors(self) -> tuple[Mutant, ...]:
        """Mutants that no gate noticed."""
        return tuple(m for m, row in zip(self.mutants, self.cells, strict=True) if "killed" not in row)

    @property
    def idle(self) -> tuple[str, ...]:
        """Gates that ran and killed nothing."""
        columns = zip(self.gates, zip(*self.cells, strict=True), strict=True)
        return tuple(gate for gate, column in columns if "killed" not in column and set(column) != {"not run"})

    @property
    def missed(self) -> tuple[Mutant, ...]:
        """Mutants that the gate which the catalogue names did not kill, though another did."""
        column = {gate: number for number, gate in enumerate(self.gates)}
        return tuple(m for m, row in zip(self.mutants, self.cells, strict=True)
                     if "killed" in row and row[column[m.killer]] != "killed")


def run_mutants(mutants: Sequence[Mutant], gates: Gates, *, catalogue: Sequence[Mutant] = (), jobs: int = 1,
                store: Path | None = None, progress: Progress = quiet) -> KillMatrix:
    """Run every gate on every mutant, in `jobs` processes; `store` keeps the references between runs.

    An image gate looks once, at the first of its looks, and goes on to its last only while no other gate has killed
    the mutant. A test module runs where a mutant of the same file (of `catalogue`, all mutants there are) names it.

    HarnessError when a mutant does not apply, does not compile or names a gate that does not exist, and when a gate
    does not pass with the shader as it is: a gate that always fails kills everything.
    """
    modules: dict[str, set[str]] = {}
    for mutant in catalogue or mutants:
        if mutant.killer not in gates.names:
            raise HarnessError(f"{mutant.where}: mutant '{mutant.id}' names the gate '{mutant.killer}', which does not "
                               f"exist; choose from {', '.join(gates.names)}")
        if mutant.killer.startswith(MODULE_PREFIX):
            modules.setdefault(mutant.file, set()).add(mutant.killer)
    rows: list[tuple[State, ...]] = []
    with (tempfile.TemporaryDirectory(prefix="mutants-") as folder, progress(len(mutants) + 1, "mutants") as advance,
          _workers(gates, store, jobs) as pool):
        needed = {name for mutant in mutants for name in modules.get(mutant.file, ())}
        for problem in pool.map(_baseline, [sorted(needed)]):  # the first process renders the references for all
            if problem:
                raise HarnessError(problem)
        advance(1)
        tasks = [(mutant, mutated_shaders(mutant, Path(folder)), sorted(modules.get(mutant.file, ())))
                 for mutant in mutants]
        for row in pool.map(_judge, *zip(*tasks, strict=True)):
            rows.append(row)
            advance(1)
    return KillMatrix(tuple(mutants), gates.names, tuple(rows))


class _Worker:
    """One process's gates, with what they share between mutants: scenes, references, the right first batches."""

    def __init__(self, gates: Gates, store: Path | None) -> None:
        self.gates = gates
        self.family = load_gates(gates.file).gates
        self.references = References(Store(store) if store else None)
        self.right: dict[str, Batch] = {}

    def first_batch(self, gate: Gate) -> Batch:
        """The unmutated tracer's first batch of a gate."""
        if gate.name not in self.right:
            with shaders_from(data_dir("glsl")):
                self.right[gate.name] = _first_batch(gate)
        return self.right[gate.name]


_worker: _Worker | None = None


@contextlib.contextmanager
def _workers(gates: Gates, store: Path | None, jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that hold the gates; started afresh, since a forked process cannot use its parent's GL context."""
    pool = ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"), initializer=_start,
                               initargs=(gates, store))
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _start(gates: Gates, store: Path | None) -> None:
    global _worker
    _worker = _Worker(gates, store)


def _baseline(modules: Sequence[str]) -> str:
    """What is wrong with the gates when the shader is right; empty where all pass."""
    worker = _current()
    for gate in worker.family:
        worker.first_batch(gate)
        outcome = run_gate(gate, worker.references).outcome
        if outcome != "pass":
            return f"{gate.origin}: gate '{gate.name}' says {outcome} of the shader as it is; mend that first"
    for module in modules:
        if _run_module(worker.gates, module) != "survived":
            return f"{module}: fails with the shader as it is; mend that first"
    return ""


def _judge(mutant: Mutant, shaders: Path, modules: Sequence[str]) -> tuple[State, ...]:
    """One row of the matrix."""
    worker = _current()
    row: dict[str, State] = dict.fromkeys(worker.gates.names, "not run")
    touched: list[Gate] = []
    with shaders_from(shaders):
        _require_compilable(mutant)
        for module in modules:
            row[module] = _run_module(worker.gates, module)
        for gate in worker.family:
            try:
                row[gate.name] = _glance(gate, worker)
            except ShaderError as error:
                raise HarnessError(f"{mutant.where}: mutant '{mutant.id}' does not compile: {error}") from None
            if row[gate.name] == "survived":
                touched.append(gate)
        for gate in touched:
            if "killed" in row.values():
                break
            row[gate.name] = "survived" if _passes(gate, worker.references) else "killed"
    return tuple(row[name] for name in worker.gates.names)


def _glance(gate: Gate, worker: _Worker) -> State:
    """A gate's first look at the shader of the moment, where it draws other pixels than the right one."""
    right, found = worker.first_batch(gate), _first_batch(gate)
    if found.rejected == right.rejected and np.array_equal(found.mean, right.mean):
        return "untouched"
    return "killed" if found.rejected > right.rejected or _fails_at_once(gate, worker.references) else "survived"


def _fails_at_once(gate: Gate, references: References) -> bool:
    """Whether the first of a gate's looks ends it with a fail."""
    scene = check_gate(gate)
    theirs, made = references.of(gate, scene), tracer(gate, scene)
    try:
        ours, replicas = Run(made, gate.spp, tile_size(scene.height, scene.width)), gate.looks[0]
        ours.grow(replicas)
        theirs.grow(replicas)
        looks = Looks(tuple(gate.spp * count for count in gate.looks))
        sequence = sequential.Sequence(looks, gate.tolerance, gate.fail_level, gate.pass_level)
        return sequence.decide(0, ours.tiles(replicas), theirs.tiles(replicas)).outcome == "fail"
    finally:
        made.release()


def _passes(gate: Gate, references: References) -> bool:
    """Whether all of a gate's looks end in a pass; a variance so large that the budget cannot decide does not."""
    try:
        return run_gate(gate, references).outcome == "pass"
    except HarnessError:
        return False


def _first_batch(gate: Gate) -> Batch:
    renderer = tracer(gate, check_gate(gate))
    try:
        return renderer.render_batch(0, 0, gate.spp)
    finally:
        renderer.release()


def _require_compilable(mutant: Mutant) -> None:
    """The display pass is in no gate's shader; what else does not compile shows where it is used."""
    if mutant.file == "display.frag":
        Program(assemble(mutant.file, data_dir("glsl"))).release()


def _run_module(gates: Gates, name: str) -> State:
    """Run one test module in this process, so that its probes see the shader of the moment."""
    import pytest

    path = next(module for module in gates.modules if module.stem == name)
    for module in [module for module in sys.modules if module.startswith("tests.")]:
        del sys.modules[module]  # what tests computed once, they computed of another shader
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        status = pytest.main([str(path), "-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"])
    if status not in (TESTS_PASSED, TESTS_FAILED):
        raise HarnessError(f"{path}: the tests cannot be run (pytest status {int(status)}); try `pytest {path}`")
    return "killed" if status == TESTS_FAILED else "survived"


def _current() -> _Worker:
    assert _worker is not None, "runs in a process that _start has prepared"
    return _worker


def save(matrix: KillMatrix, path: Path) -> None:
    """Write the matrix as JSON, for the report. StoreError where it cannot be written."""
    with write_atomically(path) as partial:
        partial.write_text(json.dumps(as_json(matrix), indent=1) + "\n", encoding="utf-8")


def as_json(matrix: KillMatrix) -> Mapping[str, object]:
    """The matrix as JSON types, for the report: mutants with what they imitate and which gates killed them."""
    return {
        "gates": list(matrix.gates),
        "mutants": [{
            "id": mutant.id, "topic": mutant.topic, "file": mutant.file, "imitates": mutant.imitates,
            "origin": mutant.origin, "killer": mutant.killer,
            "states": dict(zip(matrix.gates, row, strict=True)),
        } for mutant, row in zip(matrix.mutants, matrix.cells, strict=True)],
        "survivors": [mutant.id for mutant in matrix.survivors],
        "idle": list(matrix.idle),
    }
