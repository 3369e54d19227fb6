"""What experiments found out of a stranger's shader: its contract completed, and its faults by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from harness.shader.contract import Contract, Law
from harness.strangers.single import Encoding

# fault: what it computes, or how it averages it, is wrong whatever the scene. warning: it may be. note: good to know.
Severity = Literal["fault", "warning", "note"]
# Whom a fault concerns: the samples of single frames, how frames are joined, or the random numbers.
Part = Literal["estimator", "accumulation", "seeds", "shader"]


@dataclass(frozen=True)
class Finding:
    """One thing found.

    `kind`: its name, which does not change with what is told. `told`: one sentence, with the evidence in it. `where`:
    'file:line' of the author's, or nothing. `evidence`: the numbers.
    """

    kind: str
    severity: Severity
    part: Part
    told: str
    where: str = ""
    evidence: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True, eq=False)
class Accumulation:
    """How the author's own loop averages its frames, from the result of that loop and from the same frames drawn alone.

    `outcome`: pass where every frame counts alike (but for first ones that are thrown away), exactly or within the
    noise; fail where not; none where there is nothing to join. `weights`: of each frame in the result, None where they
    cannot be told. `factor`: the loop's mean over that of its frames.
    """

    outcome: Literal["pass", "fail", "none"]
    told: str
    frames: int
    exact: bool
    weights: np.ndarray | None = None
    factor: float = 1.0


@dataclass(frozen=True, eq=False)
class Findings:
    """`contract`: completed with the law that was found. `law_told`: it, in words, with what it was found from.
    `encoding`: what each frame is put through before it is averaged, where some line does that."""

    contract: Contract
    law_told: str
    accumulation: Accumulation
    found: tuple[Finding, ...]
    encoding: Encoding = ""
    frames: int = 0
    facts: Mapping[str, float] = field(default_factory=dict)

    @property
    def law(self) -> Law:
        """How a frame is joined to its past."""
        return self.contract.law or Law("none")

    @property
    def faults(self) -> tuple[Finding, ...]:
        """Those that make the shader wrong."""
        return tuple(one for one in self.found if one.severity == "fault")

    def has(self, kind: str) -> bool:
        """Whether something of this name was found."""
        return any(one.kind == kind for one in self.found)
