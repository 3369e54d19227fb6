"""The kill matrix as plain values: what each gate said of each mutant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from harness.mutants.catalogue import Mutant
from harness.results import KillRecord, MutantRecord
from harness.samples import json

# What a gate says of a mutant. killed: it does not pass; untouched: the shader's text, or the pixels of a first batch,
# are the same, so the gate's scene has no use for the defect; not run: a test module that is not meant for the mutant,
# or an image gate that was not needed, as enough others had killed it.
State = Literal["killed", "survived", "untouched", "not run"]


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


def save(matrix: KillMatrix, path: Path) -> None:
    """Write the matrix as JSON, for the report. StoreError where it cannot be written."""
    json.save(path, record(matrix))


def load(path: Path) -> KillRecord:
    """What `save` wrote; StoreError where the file is not that."""
    return json.load(path, _read, what="a kill matrix", mend="run `harness mutants` again")


def _read(held: Any) -> KillRecord:
    """KeyError where a mutant lacks what a gate says of it."""
    found = json.built(KillRecord, held)
    return replace(found, mutants=tuple(
        replace(mutant, states={gate: mutant.states[gate] for gate in found.gates}) for mutant in found.mutants))


def as_json(matrix: KillMatrix) -> Mapping[str, object]:
    """The matrix as JSON types: those of its record."""
    return asdict(record(matrix))


def record(matrix: KillMatrix) -> KillRecord:
    """The matrix for the report: mutants with what they imitate and which gates killed them."""
    mutants = tuple(MutantRecord(
        mutant.id, mutant.topic, mutant.file, mutant.imitates, mutant.origin, mutant.killer,
        states=dict(zip(matrix.gates, row, strict=True)))
        for mutant, row in zip(matrix.mutants, matrix.cells, strict=True))
    return KillRecord(matrix.gates, mutants, tuple(mutant.id for mutant in matrix.survivors), matrix.idle,
                      tuple(mutant.id for mutant in matrix.missed))
