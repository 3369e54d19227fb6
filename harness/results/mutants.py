"""What gates and autopsies say of seeded bugs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class MutantRecord:
    """A seeded bug, and what each gate said of it: killed, survived, untouched or not run, by the gate's name.

    `topic`, `file`: the part and the file of the shader; `imitates`, `origin`: what defect it is, and where that was
    seen; `killer`: the gate that should notice it.
    """

    id: str
    topic: str
    file: str
    imitates: str
    origin: str
    killer: str
    states: dict[str, str]


@dataclass(frozen=True)
class KillRecord:
    """What `harness mutants` found. By name: `survivors`, mutants that no gate noticed; `missed`, those that the gate
    which the catalogue names did not kill; `idle`, gates that ran and killed nothing."""

    gates: tuple[str, ...]
    mutants: tuple[MutantRecord, ...]
    survivors: tuple[str, ...]
    idle: tuple[str, ...]
    missed: tuple[str, ...]


# missed: records of a scene change, but no stage is accused. unreached: no record of any scene changes.
AutopsyOutcome = Literal["named", "misnamed", "missed", "unreached"]


@dataclass(frozen=True)
class NamedMutant:
    """An autopsy of a mutant. `wrong`: functions that its line is in, or that use what it defines; `named`: first."""

    id: str
    topic: str
    file: str
    wrong: tuple[str, ...]
    outcome: AutopsyOutcome
    scene: str = ""
    strategy: str = ""
    stage: str = ""
    named: tuple[str, ...] = ()
    place: str = ""
    share: float = 0.0
    seconds: float = 0.0


@dataclass(frozen=True)
class Acquitted:
    """What the autopsy says of a shader that is right, on one scene: the stage that it accuses, empty if none."""

    id: str
    scene: str
    strategy: str
    stage: str
    own: tuple[str, ...]


@dataclass(frozen=True)
class AutopsyScore:
    """What `harness mutants --autopsy` found."""

    mutants: tuple[NamedMutant, ...]
    variants: tuple[Acquitted, ...]

    def count(self, outcome: AutopsyOutcome) -> int:
        """How many mutants have this outcome."""
        return sum(mutant.outcome == outcome for mutant in self.mutants)

    @property
    def reached(self) -> int:
        """Mutants that change a record of some scene."""
        return len(self.mutants) - self.count("unreached")

    @property
    def accused(self) -> tuple[Acquitted, ...]:
        """Right shaders that are accused all the same."""
        return tuple(variant for variant in self.variants if variant.stage)
