"""The kill matrix as plain values: what each gate said of each mutant."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from harness.files import write_atomically
from harness.mutants.catalogue import Mutant

# What a gate says of a mutant. killed: it does not pass; untouched: the shader's text, or the pixels of a first batch,
# are the same, so the gate's scene has no use for the defect; not run: a test module that is not meant for the mutant.
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
        "idle": [*matrix.idle],
        "missed": [mutant.id for mutant in matrix.missed],
    }
