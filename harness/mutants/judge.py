"""Judges one mutant: what every gate says of a shader with the defect in it."""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from harness.errors import HarnessError, MachineError, ShaderError, StoreError
from harness.files import data_dir, shaders_from
from harness.gates import Gate, References
from harness.gates.model import MitsubaReference
from harness.gates.runner import check_gate, run_gate
from harness.gates.shaders import gate_source
from harness.gpu.context import Program
from harness.gpu.renderer import TracerRenderer
from harness.mutants.catalogue import Mutant
from harness.mutants.matrix import State
from harness.samples.estimate import Batch, with_luminance
from harness.samples.store import Store
from harness.scene import Scene
from harness.shader.source import assemble
from harness.stats.tiles import TileAccumulator, TileSamples
from harness.stats.verdicts import bias_verdict

# A gate glances before it looks: as many replicas as at its first look, of so many samples per pixel, are enough for
# most defects, and a reference of so many for each of them is far less noisy. One sample would not show what it leaves
# behind for the next.
GLANCE_SPP, GLANCE_REFERENCE_SPP = 2, 8

# pytest's status where the tests ran and one failed, and where all passed.
TESTS_FAILED, TESTS_PASSED = 1, 0


@dataclass(frozen=True, eq=False)
class _Prepared:
    """A gate with what its glance needs: its scene, the right shader and its first batch, the reference."""

    gate: Gate
    scene: Scene
    text: str
    right: Batch
    reference: TileSamples


class Judge:
    """The gates of one process, and what they share between mutants: scenes, references, what the right shader draws.

    `modules`: test modules by name, which are gates as well. `marks`: a folder in which processes tell each other which
    gates pass with the right shader.
    """

    def __init__(self, gates: Sequence[Gate], modules: Mapping[str, Path], store: Path | None, marks: Path) -> None:
        self._gates = {gate.name: gate for gate in gates}
        self._modules = modules
        self._references = References(Store(store) if store else None)
        self._right = data_dir("glsl")
        self._prepared: dict[str, _Prepared] = {}
        self._marks = {gate.name: marks / f"sound-{number}" for number, gate in enumerate(gates)}

    def check_gate(self, name: str) -> str:
        """What is wrong with a gate while the shader is right, at a glance; empty if nothing. Renders its reference."""
        prepared = self._prepare(self._gates[name])
        made = TracerRenderer(prepared.scene, prepared.gate.strategy, gate_source(prepared.gate, prepared.scene))
        try:
            return _unsound(prepared.gate) if _glance(prepared, made) == "killed" else ""
        finally:
            made.release()

    def check_module(self, name: str) -> str:
        """What is wrong with a test module while the shader is right; empty if nothing."""
        return f"{name}: fails with the shader as it is; mend that first" if self._run_module(name) == "killed" else ""

    def judge(self, mutant: Mutant, shaders: Path) -> dict[str, State]:
        """What every gate says of the shaders in the folder `shaders`, which are ours but for `mutant`.

        Every image gate glances. The one that should kill the mutant then takes all its looks, if a glance is not
        enough, and so do the others while none has killed it. A test module runs where the mutant names it.
        HarnessError where the mutant does not compile, and where a gate does not pass with the shader as it is.
        """
        prepared = [self._prepare(gate) for gate in self._gates.values()]
        states: dict[str, State] = {}
        with shaders_from(shaders):
            try:
                _require_compilable(mutant)
                states |= {each.gate.name: _first_sight(each) for each in prepared}
            except ShaderError as error:
                raise HarnessError(f"{mutant.where}: mutant '{mutant.id}' does not compile: {error}") from None
            if mutant.killer in self._modules:
                states[mutant.killer] = self._run_module(mutant.killer)
            touched = [gate for name, gate in self._gates.items() if states[name] == "survived"]
            for gate in sorted(touched, key=lambda gate: gate.name != mutant.killer):
                if gate.name != mutant.killer and "killed" in states.values():
                    break
                self._require_sound(gate)
                states[gate.name] = "survived" if self._passes(gate) else "killed"
        return states

    def _prepare(self, gate: Gate) -> _Prepared:
        """The gate, prepared once a process, with the shader as it is."""
        if gate.name not in self._prepared:
            scene = check_gate(gate)
            reference = self._references.of(_with_small_reference(gate), scene)
            reference.grow(gate.looks[0])
            source = gate_source(gate, scene)
            made = TracerRenderer(scene, gate.strategy, source)
            try:
                right = made.render_batch(0, 0, GLANCE_SPP)
            finally:
                made.release()
            self._prepared[gate.name] = _Prepared(gate, scene, source.text, right, reference.tiles(gate.looks[0]))
        return self._prepared[gate.name]

    def _require_sound(self, gate: Gate) -> None:
        """A gate that does not pass with the right shader kills everything, and so tells nothing."""
        if not self._marks[gate.name].exists():
            with shaders_from(self._right):
                if not self._passes(gate):
                    raise HarnessError(_unsound(gate))
            self._marks[gate.name].touch()

    def _passes(self, gate: Gate) -> bool:
        """Whether the gate passes; a variance so large that its budget cannot decide is no pass."""
        try:
            return run_gate(gate, self._references).outcome == "pass"
        except (MachineError, StoreError):
            raise  # a full disk kills no mutant
        except HarnessError:
            return False

    def _run_module(self, name: str) -> State:
        """Run one test module in this process, so that its probes see the shader of the moment."""
        import pytest

        path = self._modules[name]
        for module in [module for module in sys.modules if module.endswith(f".{name}")]:
            del sys.modules[module]  # what it computed once, it computed of another shader
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            status = pytest.main([str(path), "-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"])
        if status not in (TESTS_PASSED, TESTS_FAILED):
            raise HarnessError(f"{path}: the tests cannot be run (pytest status {int(status)}); try `pytest {path}`")
        return "killed" if status == TESTS_FAILED else "survived"


def _first_sight(prepared: _Prepared) -> State:
    """What a gate says of the shader of the moment at a glance, if that shader is another than the right one."""
    source = gate_source(prepared.gate, prepared.scene)
    if source.text == prepared.text:
        return "untouched"
    made = TracerRenderer(prepared.scene, prepared.gate.strategy, source)
    try:
        touched = _differ(made.render_batch(0, 0, GLANCE_SPP), prepared.right)
        return _glance(prepared, made) if touched else "untouched"
    finally:
        made.release()


def _glance(prepared: _Prepared, made: TracerRenderer) -> State:
    """What a gate says from few samples; not finite ones kill as a gate's do."""
    gate, batches = prepared.gate, prepared.gate.looks[0]
    tiles, rejected = TileAccumulator(prepared.reference.tile), 0
    for replica in range(batches):
        batch = made.render_batch(replica, 0, GLANCE_SPP)
        tiles.add(with_luminance(batch.mean), batch.samples)
        rejected += batch.rejected
    if rejected > gate.not_finite * batches * GLANCE_SPP * prepared.scene.width * prepared.scene.height:
        return "killed"
    verdict = bias_verdict(tiles.samples(), prepared.reference, gate.tolerance, fail_level=gate.fail_level)
    return "killed" if verdict.outcome == "fail" else "survived"


def _with_small_reference(gate: Gate) -> Gate:
    """The gate, its Mitsuba reference with as few samples as a glance needs."""
    if not isinstance(gate.reference, MitsubaReference):
        return gate
    return replace(gate, reference=MitsubaReference(GLANCE_REFERENCE_SPP))


def _differ(found: Batch, right: Batch) -> bool:
    return found.rejected != right.rejected or not np.array_equal(found.mean, right.mean)


def _unsound(gate: Gate) -> str:
    return f"{gate.origin}: gate '{gate.name}' does not pass with the shader as it is; mend that first"


def _require_compilable(mutant: Mutant) -> None:
    """The display pass is in no gate's shader; what else does not compile shows where it is used."""
    if mutant.file == "display.frag":
        Program(assemble(mutant.file, data_dir("glsl"))).release()
