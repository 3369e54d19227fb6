"""A rate that was counted, with its exact interval, and where a bias may lie."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from scipy import special

# Of the intervals of rates, unless the caller says otherwise.
CONFIDENCE = 0.95

Where = Literal["everywhere", "patch"]


@dataclass(frozen=True)
class Rate:
    """So many hits in so many independent trials."""

    hits: int
    trials: int

    @property
    def value(self) -> float:
        """Hits over trials."""
        return self.hits / self.trials

    def interval(self, confidence: float = CONFIDENCE) -> tuple[float, float]:
        """The exact binomial interval (Clopper and Pearson 1934)."""
        tail = (1 - confidence) / 2
        low = special.betaincinv(self.hits, self.trials - self.hits + 1, tail) if self.hits else 0.0
        high = special.betaincinv(self.hits + 1, self.trials - self.hits, 1 - tail) if self.hits < self.trials else 1.0
        return float(low), float(high)
