"""A suite of gates run a thousand times: on renders that might have been, with no bias and with known ones."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from harness.gates import Gate, GatesFile, References
from harness.gates.budget import too_small
from harness.gates.runner import check_gate, opened
from harness.progress import Progress, quiet
from harness.samples.store import Store
from harness.stats.bias import Outcome
from harness.stats.paired import PairedLooking, largest_by_size
from harness.stats.rates import Where
from harness.stats.resampling import Patch, centred, draws, mirrored, resampled, resampled_pairs, shaded_patches
from harness.stats.suites import BIASES, MISSED, GatePower, GateRates, SuiteRates
from harness.stats.synthetic import with_gain
from harness.stats.tiles import MAX_BATCHES, ImageMoments, TileSamples
from harness.work.executors import executor
from harness.work.run import FixedRun, Run

# A bank holds so many budgets of the tracer's replicas, and one of Mitsuba's, which cost three times as much.
BUDGETS = 2
# Of the simulated runs, so many at the most are repeated with each bias, in so many groups; patches of a group lie at
# one place.
BIASED_RUNS, GROUPS = 100, 20
# The biases among which the smallest that is surely seen is looked for, in tolerances: steps of 10 %.
LADDER = 1.1 ** np.arange(-14, 15)
# Streams of `draws`. All gates draw the same replicas on a side, as they do in a real run: what noise they share
# (gates of one scene the reference, strategies the random numbers) stays shared.
TEST, REFERENCE, PATCHES = range(3)

Ending = Outcome | Literal["refused"]


@dataclass(frozen=True, eq=False)
class GateBank:
    """A gate with the replicas that its simulated runs draw from; both sides have the same mean in every tile.

    `grows`: the reference's replicas are drawn as the test's are; else all of them at every look. `paired`: the plan of
    a coupled gate, whose replicas go in pairs; None of another.
    """

    gate: Gate
    test: TileSamples
    reference: TileSamples
    grows: bool
    paired: PairedLooking | None = None


@dataclass(frozen=True, eq=False)
class Simulated:
    """Endings of the runs of one gate on good renders, and what was counted."""

    endings: tuple[Ending, ...]
    rates: GateRates
    powers: tuple[GatePower, ...]


def simulate_suite(family: GatesFile, runs: int, *, store: Store | None = None, jobs: int = 1,
                   progress: Progress = quiet) -> SuiteRates:
    """Run every gate of a file so many times on renders that might have been, in `jobs` processes.

    `store` keeps Mitsuba's replicas, as a run of the gates does. HarnessError as `run_gate` raises it.
    """
    return run_banks(family, gather(family.gates, store, progress), runs, jobs=jobs, progress=progress)


def run_banks(family: GatesFile, banks: Sequence[GateBank], runs: int, *, jobs: int = 1,
              progress: Progress = quiet) -> SuiteRates:
    """The same, once the banks of the file's gates are there."""
    with progress(len(banks), "simulated runs") as advance:
        found: list[Simulated] = []
        with executor("serial" if jobs == 1 else "processes", min(jobs, len(banks))) as workers:
            for each in workers.map(partial(simulate, runs=runs), banks):
                found.append(each)
                advance(1)
    endings = np.array([each.endings for each in found])
    return SuiteRates(family.path.name, family.false_alarms, family.gates[0].fail_level, runs,
                      int((endings == "fail").any(axis=0).sum()), int((endings != "pass").any(axis=0).sum()),
                      tuple(each.rates for each in found), tuple(power for each in found for power in each.powers))


def gather(gates: Sequence[Gate], store: Store | None = None, progress: Progress = quiet) -> list[GateBank]:
    """Render a bank for every gate, centred so that it does not matter whether the tracer is right.

    HarnessError as `run_gate` raises it, and where a gate's samples are not finite, with which it always fails.
    """
    banks: list[GateBank] = []
    with References(store) as references, progress(len(gates), "replicas to draw from") as advance:
        for gate in gates:
            film = check_gate(gate)
            theirs = references.of(gate)
            drawn = min(BUDGETS * gate.replicas, MAX_BATCHES)
            theirs.grow(drawn if gate.paired else gate.replicas)
            with opened(gate) as renderer:
                ours = Run(renderer, gate.spp)
                ours.grow(drawn)
            estimate = ours.estimate()
            if estimate.rejected > gate.not_finite * estimate.samples * film.width * film.height:
                raise gate.error(f"{estimate.rejected} samples are not finite, with which the gate fails; mend that "
                                 "first")
            banks.append(_bank(gate, ours.tiles(), theirs))
            advance(1)
    return banks


def _bank(gate: Gate, ours: TileSamples, run: Run | FixedRun) -> GateBank:
    if paired := gate.paired:
        theirs = run.tiles(len(ours.samples))
        return GateBank(gate, *mirrored(ours, theirs), True, paired)
    theirs = run.tiles(gate.replicas)
    exact = theirs.samples.sum() == 0
    truth = theirs.means.mean(axis=0)
    return GateBank(gate, centred(ours, truth), theirs if exact else centred(theirs, truth), isinstance(run, Run))


def simulate(bank: GateBank, runs: int) -> Simulated:
    """What becomes of so many runs of a gate on good renders, and of some of them with a bias."""
    gate, simulation = bank.gate, Simulation(bank, runs)
    ended = [ending for chunk in np.array_split(np.arange(runs), -(-runs // BIASED_RUNS))
             for ending in simulation.endings(chunk)]
    outcomes = tuple(outcome for outcome, _ in ended)
    rates = GateRates(
        gate.name, outcomes.count("fail"), outcomes.count("inconclusive") + outcomes.count("refused"), runs,
        float(np.mean([share for _, share in ended])), gate.tolerance.mean, gate.tolerance.fine,
        simulation.surely_seen("everywhere"), simulation.surely_seen("patch"))
    return Simulated(outcomes, rates, tuple(simulation.power(where, gain) for where, gain in BIASES))


class Simulation:
    """The runs of one gate: which replicas each draws, and the references' moments, which runs with a bias share."""

    def __init__(self, bank: GateBank, runs: int) -> None:
        test, reference = len(bank.test.samples), len(bank.reference.samples)
        self.bank = bank
        self.biased = np.arange(min(BIASED_RUNS, runs))
        self._ours = draws(test, bank.gate.replicas, runs, TEST)
        self._theirs = draws(reference, bank.gate.replicas if bank.grows else reference, runs, REFERENCE)
        self._references: dict[tuple[int, int], ImageMoments] = {}

    def endings(self, runs: np.ndarray, test: TileSamples | None = None) -> list[tuple[Ending, float]]:
        """How the runs of these numbers end, and at what share of the budget, as `gates.runner.run_gate` would.

        `test`: the bank that the test draws from instead of its own.
        """
        gate = self.bank.gate
        ended: dict[int, tuple[Ending, float]] = {}
        waiting = runs
        for look, replicas in enumerate(gate.looks):
            outcomes = self._paired_outcomes if self.bank.paired else self._outcomes
            for run, outcome in zip(waiting.tolist(), outcomes(look, waiting, test or self.bank.test), strict=True):
                ended[run] = outcome, replicas / gate.replicas
            waiting = np.array([run for run in waiting.tolist() if ended[run][0] == "inconclusive"], np.intp)
            if not waiting.size:
                break
        return [ended[run] for run in runs.tolist()]

    def _outcomes(self, look: int, runs: np.ndarray, test: TileSamples) -> Iterator[Ending]:
        gate = self.bank.gate
        tests = resampled(test, self._ours[runs, :gate.looks[look]])
        for pair in zip(tests, self._reference(look, runs), strict=True):
            outcome = gate.sequence.outcome(look, *pair)
            yield "refused" if outcome == "inconclusive" and look == 0 and too_small(gate, *pair) else outcome

    def _paired_outcomes(self, look: int, runs: np.ndarray, test: TileSamples) -> Iterator[Ending]:
        """Those of a coupled gate: both sides draw the same replicas."""
        plan, reference = self.bank.paired, self.bank.reference
        assert plan is not None
        largest = largest_by_size(test, reference)
        chosen = self._ours[runs, :self.bank.gate.looks[look]]
        for contrasts in resampled_pairs(test, reference, chosen, largest, plan.pass_level):
            outcome = plan.outcome_of(look, contrasts)
            refused = outcome == "inconclusive" and look == 0 and plan.too_small_of(look, contrasts) is not None
            yield "refused" if refused else outcome

    def power(self, where: Where, gain: float) -> GatePower:
        """What becomes of runs with this bias."""
        outcomes = [outcome for group in self._biased(where, gain) for outcome in group]
        return GatePower(self.bank.gate.name, where, gain, outcomes.count("fail"), outcomes.count("pass"),
                         len(outcomes))

    def surely_seen(self, where: Where) -> float | None:
        """The smallest bias on the ladder with which no more than `MISSED` of the runs pass, as with larger ones; None
        where there is none."""
        tolerance = self.bank.gate.tolerance
        ladder = LADDER * (tolerance.mean if where == "everywhere" else tolerance.fine)
        found = first_true(lambda rung: self._is_seen(where, ladder[rung]), len(ladder), len(ladder) // 2)
        return float(ladder[found]) if found < len(ladder) else None

    def _is_seen(self, where: Where, gain: float) -> bool:
        passed = 0
        for outcomes in self._biased(where, gain):
            passed += outcomes.count("pass")
            if passed > MISSED * len(self.biased):
                return False
        return True

    def _biased(self, where: Where, gain: float) -> Iterator[list[Ending]]:
        """Outcomes of the first runs with a bias, those with a patch at one place together.

        Everything means all light, what is seen directly too: the image's mean is then off by just the gain.
        """
        test = self.bank.test
        places: Sequence[Patch | None] = [None] * GROUPS
        if where == "patch":
            places = shaded_patches(test, GROUPS, np.random.default_rng(PATCHES))
        for place, runs in zip(places, np.array_split(self.biased, GROUPS), strict=True):
            if not runs.size:
                break
            gained = (dataclasses.replace(test, means=test.means * (1 + gain)) if place is None
                      else with_gain(test, gain, place))
            yield [outcome for outcome, _ in self.endings(runs, gained)]

    def _reference(self, look: int, runs: np.ndarray) -> list[ImageMoments]:
        """The moments of the reference at a look of these runs; those of runs that biases are put into are kept."""
        bank, replicas = self.bank, self.bank.gate.looks[look]
        known = self._references
        missing = np.array([run for run in runs.tolist() if (look, run) not in known], np.intp)
        chosen = self._theirs[missing, :replicas] if bank.grows else self._theirs[missing]
        fresh = dict(zip(missing.tolist(), resampled(bank.reference, chosen), strict=True))
        known |= {(look, run): moments for run, moments in fresh.items() if run < len(self.biased)}
        return [fresh[run] if run in fresh else known[look, run] for run in runs.tolist()]


def first_true(holds: Callable[[int], bool], end: int, start: int) -> int:
    """The first number below `end` for which `holds` does, as for all after it, or `end`; looked for around `start`."""
    low, high, step = -1, end, 1  # it holds from `high` on, and not up to `low`
    guess = start
    while high - low > 1:
        if holds(guess):
            high, outwards = guess, guess - step
        else:
            low, outwards = guess, guess + step
        step *= 2
        guess = outwards if low < outwards < high and (low == -1 or high == end) else (low + high) // 2
    return high
