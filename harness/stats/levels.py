"""How a rate of false alarms is shared: among the tests of a suite, and among repeated looks at growing samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.errors import HarnessError


def family_level(level: float, tests: int) -> float:
    """The level of each of `tests` tests that together raise a false alarm with probability `level` at the most.

    Šidák 1967 ("Rectangular confidence regions for the means of multivariate normal distributions", J. Am. Statist.
    Assoc. 62): 1 - (1 - level)^(1/tests), exact for independent tests and safe for two-sided tests of normal means
    however they are correlated; tests that share a reference are. Holm's stepwise refinement (1979) needs all p-values
    at once, which tests that stop at their own time do not have. HarnessError for a level outside (0, 1), or no test.
    """
    check_level(level)
    if tests < 1:
        raise HarnessError(f"a family needs at least 1 test, found {tests}")
    return float(-np.expm1(np.log1p(-level) / tests))


def check_level(level: float) -> None:
    """HarnessError unless 0 < level < 1."""
    if not 0 < level < 1:
        raise HarnessError(f"an error rate must lie between 0 and 1 (0.01 is 1 %), found {level}")


@dataclass(frozen=True)
class Looks:
    """The samples per pixel at which a growing estimate is looked at; increasing, the last is the budget.

    An error rate is spent as samples are: linearly (Kim and DeMets 1987, "Design and analysis of group sequential
    tests based on the type I error spending rate function", Biometrika 74, with exponent 1). Look k has the level
    α (n_k - n_(k-1)) / n_K, so that all looks together err with probability at most α *whatever the dependence between
    them* (union bound): nothing is assumed of normality or of increments, as Lan and DeMets' exact boundaries do.
    Measured for looks that double, on a normal mean whose tolerance is 5 of its standard errors at the budget: an
    unbiased render passes with probability .994 after 65 % of the budget on average (boundaries of O'Brien and
    Fleming's kind, spent by the same bound: .998 after 72 %; equal levels: .986 after 67 %), a bias of four times the
    tolerance fails after 14 % of it (40 %; 12 %).
    """

    samples: tuple[int, ...]

    def __post_init__(self) -> None:
        if not self.samples or self.samples[0] < 1 or (np.diff(self.samples) <= 0).any():
            raise HarnessError(f"looks must be at increasing numbers of samples, found {self.samples}")

    def level(self, look: int, total: float) -> float:
        """The share of the error rate `total` that look number `look`, from 0, may spend."""
        before = self.samples[look - 1] if look else 0
        return total * (self.samples[look] - before) / self.samples[-1]
