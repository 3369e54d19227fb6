"""What was counted over simulated runs of a suite of gates, and which of its gates see what."""

from __future__ import annotations

from dataclasses import dataclass

from harness.stats.rates import Rate, Where

# A bias counts as surely seen where no more than this share of runs passed.
MISSED = 0.05
# Gates that leave good renders undecided more often than this are flaky.
FLAKY = 0.001
# The biases that the suite promises to see, of everything and in a square of 1 % of the image, and twice these.
PROMISED: dict[Where, float] = {"everywhere": 0.002, "patch": 0.05}
BIASES: tuple[tuple[Where, float], ...] = tuple(
    (where, factor * promised) for where, promised in PROMISED.items() for factor in (1, 2))


@dataclass(frozen=True)
class GateRates:
    """What became of good renders in `trials` runs of one gate, and what bias it takes to be noticed.

    `failed`: false alarms; `undecided`: the budget ended, or was refused as too small after the first look. `share`: of
    the budget, on average, that was drawn. `mean`, `fine`: the gate's tolerances. `sure_everywhere`, `sure_patch`: the
    smallest bias with which no more than `MISSED` of runs passed; None where none was large enough.
    """

    gate: str
    failed: int
    undecided: int
    trials: int
    share: float
    mean: float
    fine: float
    sure_everywhere: float | None
    sure_patch: float | None

    @property
    def flaky(self) -> bool:
        """Does the gate leave good renders undecided more often than it should?"""
        return self.undecided > FLAKY * self.trials

    def sure(self, where: Where) -> bool:
        """Is it sure to see what the suite promises?"""
        smallest = self.sure_everywhere if where == "everywhere" else self.sure_patch
        return smallest is not None and smallest <= PROMISED[where]


@dataclass(frozen=True)
class GatePower:
    """Of `trials` runs of a gate whose test was too bright by `gain`, `where`, so many failed, and so many passed."""

    gate: str
    where: Where
    gain: float
    failed: int
    passed: int
    trials: int


@dataclass(frozen=True)
class SuiteRates:
    """Simulated runs of the gates of `file` on good renders: in `failed` of `runs` some gate failed, in `red` some gate
    did not pass. `false_alarms`: the rate that is asked for at the most; `level`: each gate's share of it."""

    file: str
    false_alarms: float
    level: float
    runs: int
    failed: int
    red: int
    gates: tuple[GateRates, ...]
    powers: tuple[GatePower, ...]

    @property
    def alarms(self) -> Rate:
        """Runs in which some gate failed."""
        return Rate(self.failed, self.runs)

    @property
    def not_green(self) -> Rate:
        """Runs in which some gate did not pass."""
        return Rate(self.red, self.runs)

    @property
    def excessive(self) -> bool:
        """Are there more false alarms than were asked for, chance apart?"""
        return self.alarms.interval()[0] > self.false_alarms
