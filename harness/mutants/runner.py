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
from harness.estimate import Batch, with_luminance
from harness.files import data_dir, shaders_from, write_atomically
from harness.gates import Gate, References, load_gates
from harness.gates.runner import check_gate, run_gate, tracer
from harness.mutants.catalogue import Mutant, mutated_shaders
from harness.runs import Progress, quiet
from harness.scene import Scene
from harness.stats.tiles import TileAccumulator, TileSamples
from harness.stats.verdicts import bias_verdict
from harness.store import Store
from harness.tracer.context import Program
from harness.tracer.source import assemble

# What a gate says of a mutant. killed: it does not pass; untouched: the pixels of a first batch are the same bits, so
# the gate's scene has no use for the defect; not run: a test module that is not meant for the mutant.
State = Literal["killed", "survived", "untouched", "not run"]

# Files of tests whose names begin so are gates as well: what probes say of one function of the shader library.
MODULE_PREFIX = "test_"
MODULES_FOLDER = "tracer"
# Of the samples of a gate's first look, the part that a glance takes.
GLANCE_SHARE = 8

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


def run_mutants(mutants: Sequence[Mutant], gates: Gates, *, jobs: int = 1,
                store: Path | None = None, progress: Progress = quiet) -> KillMatrix:
    """Run every gate on every mutant, in `jobs` processes; `store` keeps the references between runs.

    An image gate glances at an eighth of its first look, which is enough for most defects, and takes all its looks only
    while no other gate has killed the mutant. A test module runs where the mutant names it as its killer.

    HarnessError when a mutant does not apply, does not compile or names a gate that does not exist, and when a gate
    does not pass with the shader as it is: a gate that always fails kills everything.
    """
    for mutant in mutants:
        if mutant.killer not in gates.names:
            raise HarnessError(f"{mutant.where}: mutant '{mutant.id}' names the gate '{mutant.killer}', which does not "
                               f"exist; choose from {', '.join(gates.names)}")
    stems = {module.stem for module in gates.modules}
    rows: list[tuple[State, ...]] = []
    with (tempfile.TemporaryDirectory(prefix="mutants-") as folder, progress(len(mutants) + 1, "mutants") as advance,
          _workers(gates, store, jobs) as pool):
        needed = sorted({mutant.killer for mutant in mutants if mutant.killer in stems})
        if problem := pool.submit(_baseline, needed, True).result():  # its references are then in the store for all
            raise HarnessError(problem)
        advance(1)
        tasks = [(mutant, mutated_shaders(mutant, Path(folder)), [mutant.killer] if mutant.killer in stems else [])
                 for mutant in mutants]
        for row in pool.map(_judge, *zip(*tasks, strict=True)):
            rows.append(row)
            advance(1)
    return KillMatrix(tuple(mutants), gates.names, tuple(rows))


@dataclass(frozen=True, eq=False)
class _Prepared:
    """A gate with what its glance needs: the scene, the right tracer's first batch, all of the reference."""

    gate: Gate
    scene: Scene
    right: Batch
    reference: TileSamples


class _Worker:
    """One process's gates, and what they share between mutants."""

    def __init__(self, gates: Gates, store: Path | None) -> None:
        self.gates = gates
        self.family = load_gates(gates.file).gates
        self.references = References(Store(store) if store else None)
        self._prepared: dict[str, _Prepared] = {}

    def prepared(self, gate: Gate) -> _Prepared:
        """The gate, prepared once a process, with the shader as it is."""
        if gate.name not in self._prepared:
            scene = check_gate(gate)
            reference = self.references.of(gate, scene)
            reference.grow(gate.replicas)
            made = tracer(gate, scene)
            right = made.render_batch(0, 0, _glance_spp(gate))
            made.release()
            self._prepared[gate.name] = _Prepared(gate, scene, right, reference.tiles(gate.replicas))
        return self._prepared[gate.name]


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


def _baseline(modules: Sequence[str], check: bool) -> str:
    """Prepare the gates; what is wrong with them when the shader is right, where `check` asks, and empty otherwise."""
    worker = _current()
    for gate in worker.family:
        worker.prepared(gate)
        if check and not _passes(gate, worker.references):
            return f"{gate.origin}: gate '{gate.name}' does not pass with the shader as it is; mend that first"
    for module in modules if check else ():
        if _run_module(worker.gates, module) != "survived":
            return f"{module}: fails with the shader as it is; mend that first"
    return ""


def _judge(mutant: Mutant, shaders: Path, modules: Sequence[str]) -> tuple[State, ...]:
    """One row of the matrix."""
    worker = _current()
    prepared = [worker.prepared(gate) for gate in worker.family]  # while the shader is as it should be
    row: dict[str, State] = dict.fromkeys(worker.gates.names, "not run")
    with shaders_from(shaders):
        _require_compilable(mutant)
        for each in prepared:
            try:
                row[each.gate.name] = _glance(each)
            except ShaderError as error:
                raise HarnessError(f"{mutant.where}: mutant '{mutant.id}' does not compile: {error}") from None
        for module in modules:
            row[module] = _run_module(worker.gates, module)
        touched = [gate for gate in worker.family if row[gate.name] == "survived"]
        for gate in sorted(touched, key=lambda gate: gate.name != mutant.killer):
            if "killed" in row.values():
                break
            row[gate.name] = "survived" if _passes(gate, worker.references) else "killed"
    return tuple(row[name] for name in worker.gates.names)


def _glance(prepared: _Prepared) -> State:
    """What a gate says of the shader of the moment from a few samples: enough for most defects."""
    gate, spp = prepared.gate, _glance_spp(prepared.gate)
    made = tracer(gate, prepared.scene)
    try:
        found = made.render_batch(0, 0, spp)
        if found.rejected == prepared.right.rejected and np.array_equal(found.mean, prepared.right.mean):
            return "untouched"
        if found.rejected > gate.not_finite * found.mean.size:
            return "killed"
        tiles = TileAccumulator(prepared.reference.tile)
        tiles.add(with_luminance(found.mean), spp)
        for replica in range(1, gate.looks[0]):
            tiles.add(with_luminance(made.render_batch(replica, 0, spp).mean), spp)
        verdict = bias_verdict(tiles.samples(), prepared.reference, gate.tolerance, fail_level=gate.fail_level)
        return "killed" if verdict.outcome == "fail" else "survived"
    finally:
        made.release()


def _glance_spp(gate: Gate) -> int:
    """Samples per pixel of each replica at a glance."""
    return max(1, gate.spp // GLANCE_SHARE)


def _passes(gate: Gate, references: References) -> bool:
    """Whether all of a gate's looks end in a pass; a variance so large that the budget cannot decide does not."""
    try:
        return run_gate(gate, references).outcome == "pass"
    except HarnessError:
        return False


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
