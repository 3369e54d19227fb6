"""A look and what was learnt of it: what the taps recorded, and what Mitsuba answered, each asked for once."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any, TypeVar

from harness.gpu.tap import Look, Observed, Records

T = TypeVar("T")


@dataclass(eq=False)
class Seen:
    """`look` and what it observed. Of a look that is kept, questions that are asked again find all answers here."""

    look: Look
    observed: Observed
    _answers: dict[Hashable, Any] = field(default_factory=dict)

    @property
    def paths(self) -> Records:
        """The records of paths, (N, 4) each."""
        return self.observed.paths

    def vertex(self, number: int) -> Records:
        """Those of a vertex."""
        return self.observed.vertices[number]

    def once(self, key: Hashable, answer: Callable[[], T]) -> T:
        """The answer that this key had the first time."""
        if key not in self._answers:
            self._answers[key] = answer()
        found: T = self._answers[key]
        return found
