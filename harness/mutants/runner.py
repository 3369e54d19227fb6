"""Runs mutants against gates, in several processes: which gate notices which defect."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from harness.errors import HarnessError
from harness.gates import Gate, load_gates
from harness.mutants.catalogue import Mutant, mutated
from harness.mutants.judge import Judge
from harness.mutants.matrix import KillMatrix, State
from harness.mutants.memory import Memory
from harness.progress import Progress, quiet
from harness.work.executors import executor

# Files of tests whose names begin so are gates as well: what probes say of one function of the shader library.
MODULE_PREFIX = "test_"
MODULE_FOLDERS = ("glsl", "gpu")
SUPPORT_FOLDER = "support"


@dataclass(frozen=True)
class Gates:
    """All gates of a run: those of a file, by name, and the test modules of a folder of tests; `folders`: what these
    modules may depend on."""

    file: Path
    modules: tuple[Path, ...]
    names: tuple[str, ...]
    folders: tuple[Path, ...] = ()

    @classmethod
    def of(cls, file: Path, tests: Path) -> Gates:
        """HarnessError for a malformed gates file, or a folder without test modules."""
        family = _image_gates(file)
        modules = tuple(sorted((path for folder in MODULE_FOLDERS
                                for path in (tests / folder).glob(f"{MODULE_PREFIX}*.py")), key=lambda path: path.name))
        if not modules:
            raise HarnessError(f"{tests}: no test modules in {' and '.join(MODULE_FOLDERS)}; name the folder "
                               "of the harness's tests")
        names = (*(gate.name for gate in family), *(module.stem for module in modules))
        return cls(file, modules, names, tuple(tests / name for name in (*MODULE_FOLDERS, SUPPORT_FOLDER)))


def run_mutants(mutants: Sequence[Mutant], gates: Gates, *, jobs: int = 1, full: bool = False,
                store: Path | None = None, progress: Progress = quiet) -> KillMatrix:
    """Run gates on every mutant until it is known well enough, or all of them (`full`), in `jobs` processes;
    `store` keeps the references between runs, and where there is one, so is what was said of each mutant, as soon as it
    is judged: an interrupted run goes on where it was.

    What is run of each gate: `judge.Judge.judge`. HarnessError when a mutant does not apply, does not compile or names
    a gate that does not exist, and when, with the shader as it is, a test module fails, a gate fails at a glance, or
    one that takes all its looks does not pass: what always fails kills everything.
    """
    for mutant in mutants:
        if mutant.killer not in gates.names:
            raise HarnessError(f"{mutant.where}: mutant '{mutant.id}' names the gate '{mutant.killer}', which does not "
                               f"exist; choose from {', '.join(gates.names)}")
    for mutant in mutants:
        mutated(mutant)  # one that does not apply shows before the first is judged
    image_gates = _image_gates(gates.file)
    memory = Memory(image_gates, gates.file, gates.folders) if store else None
    known = {mutant.id: states for mutant in mutants if memory and (states := memory.recall(mutant, full=full))}
    left = [mutant for mutant in mutants if mutant.id not in known]
    stems = [module.stem for module in gates.modules]
    needed = sorted({mutant.killer for mutant in left if mutant.killer in stems})
    checks = [*_by_scene(image_gates), *([module] for module in needed)] if left else []
    with (tempfile.TemporaryDirectory(prefix="mutants-") as folder, progress(len(checks) + len(left), "mutants")
          as advance, executor("processes", jobs, partial(_start, gates, store, Path(folder), full)) as pool):
        for problem in pool.map(_check, checks):
            if problem:
                raise HarnessError(problem)
            advance(1)
        for mutant, states in zip(left, pool.map(_judge, left), strict=True):
            known[mutant.id] = states
            if memory:
                memory.keep(mutant, states, full=full)
            advance(1)
    rows = [tuple(known[mutant.id].get(name, "not run") for name in gates.names) for mutant in mutants]
    return KillMatrix(tuple(mutants), gates.names, tuple(rows))


def _image_gates(file: Path) -> tuple[Gate, ...]:
    """The gates whose reference is independent. Coupled ones would each kill nearly all, and hide which others do; what
    the oracle makes of mutants is told by autopsies, which name them."""
    return tuple(gate for gate in load_gates(file).gates if gate.agreement is None)


def _by_scene(gates: Iterable[Gate]) -> list[list[str]]:
    """Names of the gates that share a reference, which one process had better render."""
    groups: dict[object, list[str]] = {}
    for gate in gates:
        groups.setdefault(gate.scene, []).append(gate.name)
    return list(groups.values())


_here: Judge | None = None


def _start(gates: Gates, store: Path | None, folder: Path, full: bool) -> None:
    global _here
    # Mutants are compiled far more often than they are drawn. Mesa's llvmpipe compiles twice as fast without LLVM's
    # optimisations, to the same bits, and draws 2 to 18 % slower, ray marching 80 %. It reads these when GL starts.
    os.environ.setdefault("GALLIVM_PERF", "nopt")
    _here = Judge(_image_gates(gates.file), {module.stem: module for module in gates.modules}, store, folder, full=full)


def _check(names: Sequence[str]) -> str:
    """The first that is wrong with gates and test modules while the shader is right."""
    judge = _judge_here()
    problems = (judge.check_module(name) if name.startswith(MODULE_PREFIX) else judge.check_gate(name)
                for name in names)
    return next(filter(None, problems), "")


def _judge(mutant: Mutant) -> dict[str, State]:
    return _judge_here().judge(mutant)


def _judge_here() -> Judge:
    assert _here is not None, "runs in a process that _start has prepared"
    return _here
