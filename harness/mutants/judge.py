"""Judges one mutant: what every gate says of a shader with the defect in it."""

from __future__ import annotations

import contextlib
import io
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from harness.errors import HarnessError, MachineError, ShaderError, StoreError
from harness.estimators.base import Renderer
from harness.estimators.tracer import Tracer
from harness.gates import Gate, References
from harness.gates.runner import check_gate, run_gate
from harness.gpu.context import Program, device
from harness.mutants.catalogue import Mutant, mutated
from harness.mutants.matrix import State
from harness.samples.estimate import Batch, with_luminance
from harness.samples.store import Store
from harness.scene import Film, Scene
from harness.shader.conditionals import preprocess
from harness.shader.lexer import without_comments
from harness.shader.library import OURS, Library
from harness.shader.source import ShaderSource
from harness.stats.tiles import TileAccumulator, TileSamples
from harness.stats.verdicts import bias_verdict

# A gate glances before it looks: as many replicas as at its first look, of so many samples per pixel, are enough for
# most defects, and a reference of so many for each of them is far less noisy. One sample would not show what it leaves
# behind for the next.
GLANCE_SPP, GLANCE_REFERENCE_SPP = 2, 8
# Gates that kill a mutant before the others are spared their glance, each of which compiles another shader; and so many
# whose pixels it changes, if one of them has killed it. Asked all of fifty, gates took three times as long, and killed
# alone 102 of 316 mutants, where 109 are killed alone by those asked.
ENOUGH, ASKED = 4, 12

# pytest's status where the tests ran and one failed, and where all passed.
TESTS_FAILED, TESTS_PASSED = 1, 0


@dataclass(frozen=True, eq=False)
class _Prepared:
    """A gate with what its glance needs: the film, the scene, the right shader and its first batch, the reference;
    `lines`: those of `compiled`, to look one up."""

    gate: Gate
    test: Tracer
    film: Film
    scene: Scene
    compiled: tuple[str, ...]
    lines: frozenset[str]
    right: Batch
    reference: TileSamples


class Judge:
    """The gates of one process, and what they share between mutants: references, what the right shader draws.

    `modules`: test modules by name, which are gates as well. `marks`: a folder in which processes tell each other which
    gates pass with the right shader. `full`: every gate glances at every mutant, not until it is known well enough.
    """

    def __init__(self, gates: Sequence[Gate], modules: Mapping[str, Path], store: Path | None, marks: Path, *,
                 full: bool = False) -> None:
        self._full = full
        self._gates = {gate.name: gate for gate in gates}
        self._modules = modules
        self._references = References(Store(store) if store else None)
        self._prepared: dict[str, _Prepared] = {}
        self._marks = {gate.name: marks / f"sound-{number}" for number, gate in enumerate(gates)}

    def check_gate(self, name: str) -> str:
        """What is wrong with a gate while the shader is right, at a glance; empty if nothing. Renders its reference."""
        prepared = self._prepare(self._gates[name])
        with prepared.test.compiled(prepared.scene, prepared.test.source_of(prepared.scene)) as renderer:
            return _unsound(prepared.gate) if _glance(prepared, renderer) == "killed" else ""

    def check_module(self, name: str) -> str:
        """What is wrong with a test module while the shader is right; empty if nothing."""
        failed = self._run_module(name, OURS) == "killed"
        return f"{name}: fails with the shader as it is; mend that first" if failed else ""

    def judge(self, mutant: Mutant) -> dict[str, State]:
        """What gates say of the shader with the mutant in it; those that are not asked are left out.

        The one that should kill the mutant comes first: a test module runs, an image gate glances. Then image gates
        glance until it is known well enough, or all have. If a glance is not enough, the one that should kill it takes
        all its looks, and so do the others while none has. HarnessError where the mutant does not apply or compile, and
        where a gate does not pass with the shader as it is.
        """
        library = mutated(mutant)
        states: dict[str, State] = {}
        try:
            _require_compilable(mutant, library)
            if mutant.killer in self._modules:
                states[mutant.killer] = self._run_module(mutant.killer, library)
            for gate in self._in_turn(mutant):
                if not self._full and _is_known(list(states.values())):
                    break
                states[gate.name] = _first_sight(self._prepare(gate), mutant)
        except ShaderError as error:
            raise HarnessError(f"{mutant.where}: mutant '{mutant.id}' does not compile: {error}") from None
        touched = [gate for name, gate in self._gates.items() if states.get(name) == "survived"]
        for gate in sorted(touched, key=lambda gate: gate.name != mutant.killer):
            if gate.name != mutant.killer and "killed" in states.values():
                break
            self._require_sound(gate)
            infected = replace(gate, test=_infected(self._prepared[gate.name], mutant))
            states[gate.name] = "survived" if self._passes(infected) else "killed"
        return states

    def _in_turn(self, mutant: Mutant) -> list[Gate]:
        """The image gates, the one that should kill it first, the others from one on that differs between mutants: each
        gate is then asked of about as many."""
        gates = list(self._gates.values())
        first = zlib.crc32(mutant.id.encode()) % len(gates)
        return sorted(gates[first:] + gates[:first], key=lambda gate: gate.name != mutant.killer)

    def _prepare(self, gate: Gate) -> _Prepared:
        """The gate, prepared once a process, with the shader as it is. HarnessError for one that judges no tracer."""
        if gate.name not in self._prepared:
            film = check_gate(gate)
            test = gate.test
            if not isinstance(test, Tracer):
                raise gate.error(f"judges '{test.name}', which has no shader of ours to put a mutant into; give it a "
                                 "'strategy', or name another gates file")
            reference = self._references.of(_with_small_reference(gate))
            reference.grow(gate.looks[0])
            scene = test.reading(gate.scene)
            with test.compiled(scene, test.source_of(scene)) as renderer:
                right = renderer.render_batch(0, 0, GLANCE_SPP)
                compiled = _compiled(renderer.source)
                self._prepared[gate.name] = _Prepared(gate, test, film, scene, compiled, frozenset(compiled), right,
                                                      reference.tiles(gate.looks[0]))
        return self._prepared[gate.name]

    def _require_sound(self, gate: Gate) -> None:
        """A gate that does not pass with the right shader kills everything, and so tells nothing."""
        if not self._marks[gate.name].exists():
            if not self._passes(gate):
                raise HarnessError(_unsound(gate))
            self._marks[gate.name].touch()

    def _passes(self, gate: Gate) -> bool:
        """Whether the gate passes; a variance so large that its budget cannot decide is no pass."""
        try:
            return run_gate(gate, self._references, ladder=False).outcome == "pass"
        except (MachineError, StoreError):
            raise  # a full disk kills no mutant
        except HarnessError:
            return False

    def _run_module(self, name: str, library: Library) -> State:
        """Run one test module in this process, on a library that it asks the plugin for."""
        import pytest

        from harness.mutants.under_test import LibraryUnderTest

        path = self._modules[name]
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            status = pytest.main([str(path), "-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"],
                                 plugins=[LibraryUnderTest(library)])
        if status not in (TESTS_PASSED, TESTS_FAILED):
            raise HarnessError(f"{path}: the tests cannot be run (pytest status {int(status)}); try `pytest {path}`")
        return "killed" if status == TESTS_FAILED else "survived"


def _is_known(states: Sequence[State]) -> bool:
    """Whether a mutant is known well enough."""
    killed, survived = states.count("killed"), states.count("survived")
    return killed >= ENOUGH or (killed >= 1 and killed + survived >= ASKED)


def _infected(prepared: _Prepared, mutant: Mutant) -> Tracer:
    """What the gate judges, with the mutant in the library."""
    return replace(prepared.test, library=mutated(mutant, prepared.test.library))


def _first_sight(prepared: _Prepared, mutant: Mutant) -> State:
    """What a gate says of a mutant at a glance, if its shader is another than the right one."""
    if _is_left_out(prepared, mutant):
        return "untouched"
    infected = _infected(prepared, mutant)
    source = infected.source_of(prepared.scene)
    if _compiled(source) == prepared.compiled:
        return "untouched"
    with infected.compiled(prepared.scene, source) as renderer:
        touched = _differ(renderer.render_batch(0, 0, GLANCE_SPP), prepared.right)
        return _glance(prepared, renderer) if touched else "untouched"


def _is_left_out(prepared: _Prepared, mutant: Mutant) -> bool:
    """Whether a compiler does not see the line that the mutant exchanges, told without writing another shader.

    Not told of what decides which lines are seen, nor of a line that takes no whole line of ours.
    """
    line, *others = (each.strip() for each in without_comments(mutant.line, mutant.id).splitlines())
    return not others and not line.startswith("#") and not mutant.replacement.startswith("#") and \
        line not in prepared.lines


def _compiled(source: ShaderSource) -> tuple[str, ...]:
    """What a compiler sees of a shader on this device: its directives, and the lines that they leave.

    Most gates leave out most of what samples lights, and are then untouched without a compiler's time.
    """
    seen = preprocess(without_comments(device().fitted(source).text, "the shader"))
    kept = (f"{name} {value}" for name, value in sorted(seen.macros.items()))
    return (*kept, *(line for line in map(str.strip, seen.text.splitlines()) if line))


def _glance(prepared: _Prepared, renderer: Renderer) -> State:
    """What a gate says from few samples; not finite ones kill as a gate's do."""
    gate, batches = prepared.gate, prepared.gate.looks[0]
    tiles, rejected = TileAccumulator(prepared.reference.tile), 0
    for replica in range(batches):
        batch = renderer.render_batch(replica, 0, GLANCE_SPP)
        tiles.add(with_luminance(batch.mean), batch.samples)
        rejected += batch.rejected
    if rejected > gate.not_finite * batches * GLANCE_SPP * prepared.film.width * prepared.film.height:
        return "killed"
    verdict = bias_verdict(tiles.samples(), prepared.reference, gate.tolerance, fail_level=gate.fail_level)
    return "killed" if verdict.outcome == "fail" else "survived"


def _with_small_reference(gate: Gate) -> Gate:
    """The gate, its reference with as few samples as a glance needs, where they are drawn."""
    return replace(gate, reference_spp=min(gate.reference_spp, GLANCE_REFERENCE_SPP))


def _differ(found: Batch, right: Batch) -> bool:
    return found.rejected != right.rejected or not np.array_equal(found.mean, right.mean)


def _unsound(gate: Gate) -> str:
    return f"{gate.origin}: gate '{gate.name}' does not pass with the shader as it is; mend that first"


def _require_compilable(mutant: Mutant, library: Library) -> None:
    """The display pass is in no gate's shader; what else does not compile shows where it is used."""
    if mutant.file == "display.frag":
        Program(library.assembled(mutant.file)).release()
