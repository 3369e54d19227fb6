"""Simulated runs of gates: they end as real ones do, err as seldom as they should, and show it where they do not."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from harness.calibration import suite
from harness.calibration.suite import BUDGETS, GateBank, Simulation, first_true, gather, run_banks, simulate
from harness.errors import HarnessError
from harness.estimators.tracer import Tracer
from harness.gates import Gate, GatesFile, References, load_gates, run_gate
from harness.stats.levels import Looks
from harness.stats.paired import COUPLED, PairedLooking
from harness.stats.partings import PARTINGS, draw_pair
from harness.stats.resampling import draws, mirrored
from harness.stats.suites import PROMISED, SuiteRates
from harness.stats.synthetic import Plan
from harness.stats.tiles import TileSamples, tile_size
from harness.stats.verdicts import Tolerance
from harness.work.run import Run
from tests.support.fakes import NoiseRenderer
from tests.support.gates import GATES, Noise, judging, one_gate, write

SIDE = 12
# Of a sample of an image of that size: enough for some runs to be decided sooner than others.
SOME_NOISE = 0.016
# Gates that look at noise of 1 % a sample.
FAMILY = "".join(f'''
[[gate]]
name = "sky-{number}"
scene = "sky.xml"
strategy = "cosine"
reason = "Noise."
''' for number in range(4))
# A gate whose tolerance is nothing beside its noise: each of its tests rejects as often as its level says.
STRICT = '''
[suite]
false_alarms = 0.1
[defaults]
size = [12, 12]
spp = 1
reference = { value = [0.5, 0.5, 0.5] }
tolerance = { mean = 1e-6, coarse = 1e-6, fine = 1e-6 }
''' + FAMILY


def noise(gate: Gate, seed: int = 0, bias: float = 0.0, sigma: float = 0.01, replicas: int = 128) -> TileSamples:
    """Replicas of a renderer of known noise, as tiles of the gate."""
    width, height = gate.scene.size or (0, 0)
    run = Run(NoiseRenderer(0.5 * (1 + bias), sigma, (height, width)), 1)
    run.replicas = seed  # another stream
    run.grow(seed + replicas)
    return run.tiles(replicas)


def small(gate: Gate) -> Gate:
    """The gate at another size."""
    return dataclasses.replace(gate, scene=gate.scene.sized(SIDE, SIDE))


def bank(gate: Gate, seed: int = 0, sigma: float = 0.01) -> GateBank:
    """A bank against a closed form."""
    with References() as references:
        return suite._bank(gate, noise(gate, seed, sigma=sigma), references.of(gate))


class TestEndings:
    """What a simulated run comes to."""

    @pytest.mark.parametrize(("bias", "sigma", "ending"), [
        (0.0, 0.01, "pass"), (0.0, 0.05, "pass"), (0.01, 0.01, "fail"), (0.002, 0.01, "inconclusive"),
        (0.0, 1.0, "refused"), (0.5, 0.3, "fail")])
    def test_is_what_a_real_run_of_the_same_replicas_comes_to(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bias: float, sigma: float, ending: str,
    ) -> None:
        """One run that draws the replicas 0, 1, … in their order, and `run_gate` of the renderer that they are of."""
        gate = one_gate(tmp_path)
        monkeypatch.setattr(suite, "draws", lambda size, replicas, runs, stream: np.arange(replicas)[None])
        exact = TileSamples.exact(np.full((40, 40, 4), 0.5), tile_size(40, 40))
        drawn = GateBank(gate, noise(gate, bias=bias, sigma=sigma), exact, grows=False)
        (outcome, share), = Simulation(drawn, 1).endings(np.arange(1))
        assert outcome == ending
        if ending == "refused":
            with pytest.raises(HarnessError, match="too small to decide"):
                run_gate(judging(gate, Noise(bias, sigma)))
        else:
            real = run_gate(judging(gate, Noise(bias, sigma)))
            assert (outcome, share) == (real.outcome, real.test.samples / 64)

    def test_does_not_depend_on_the_runs_around(self, tmp_path: Path) -> None:
        simulation = Simulation(bank(small(one_gate(tmp_path)), sigma=SOME_NOISE), 20)
        together = simulation.endings(np.arange(20))
        assert len({share for _, share in together}) > 1
        alone = [ending for run in range(20) for ending in simulation.endings(np.array([run]))]
        assert alone == together


class TestCoupled:
    """Gates whose reference draws the same random numbers."""

    def bank(self, gate: Gate, expected: float = 30.0) -> GateBank:
        """128 pairs of replicas of 64 samples per pixel, of which so many part."""
        gate = dataclasses.replace(gate, tolerance=COUPLED, spp=64)
        plan = PairedLooking(Looks(tuple(64 * replicas for replicas in gate.looks)), COUPLED)
        test, reference = draw_pair(PARTINGS["even"], Plan(60, 128, 64), expected, np.random.default_rng(3))
        return GateBank(gate, *mirrored(test, reference), True, plan)

    def test_runs_draw_the_same_replicas_of_both_sides(self, tmp_path: Path) -> None:
        """They end as the plan ends on just these pairs; drawn apart they would be noise, and never decided."""
        held = self.bank(one_gate(tmp_path))
        plan = held.paired
        assert plan is not None
        found = Simulation(held, 5).endings(np.arange(5))
        chosen = draws(256, 64, 5, suite.TEST)
        for run, (outcome, share) in zip(chosen, found, strict=True):
            batches = round(64 * share)
            sides = held.test.chosen(run[:batches]), held.reference.chosen(run[:batches])
            assert plan.outcome(held.gate.looks.index(batches), *sides) == outcome == "pass"

    def test_are_sharp(self, tmp_path: Path) -> None:
        held = self.bank(one_gate(tmp_path))
        found = simulate(held, 3)
        assert found.rates.failed == found.rates.undecided == 0
        assert 0.5 * COUPLED.mean < (found.rates.sure_everywhere or 1.0) <= 1.1 * COUPLED.mean
        assert all(power.failed == power.trials for power in found.powers)

    def test_a_budget_within_the_rule_of_three_is_refused(self, tmp_path: Path) -> None:
        """Samples as bright as a lamp's, of which nobody can say after so few that none parts."""
        held = self.bank(one_gate(tmp_path))
        assert held.paired is not None
        lamps = np.full_like(held.reference.means, 100.0)
        held = dataclasses.replace(held, reference=dataclasses.replace(held.reference, brightest=lamps))
        assert {outcome for outcome, _ in Simulation(held, 5).endings(np.arange(5))} == {"refused"}


class TestRates:
    """False alarms of a whole file."""

    def measured(self, folder: Path) -> SuiteRates:
        family = load_gates(write(folder, STRICT))
        return run_banks(family, [bank(gate, 1000 * number) for number, gate in enumerate(family.gates)], 40)

    def test_are_no_more_than_asked_for_but_where_the_rate_is_not_shared(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        """Among gates, and among the three tests of each. No budget is too small here, or gates with such tolerances
        would not get beyond their first look."""
        monkeypatch.setattr(suite, "too_small", lambda *arguments: False)
        monkeypatch.setattr(Simulation, "surely_seen", lambda self, where: None)
        monkeypatch.setattr(suite, "BIASES", ())
        found = self.measured(tmp_path)
        assert found.red == found.runs == 40 and not found.excessive
        for module in ("gates.parser", "stats.verdicts"):
            monkeypatch.setattr(f"harness.{module}.family_level", lambda level, tests: level)
        broken = self.measured(tmp_path)
        assert broken.excessive and broken.failed > found.failed
        assert max(gate.failed for gate in broken.gates) < broken.failed < sum(gate.failed for gate in broken.gates)


class TestPower:
    """What it takes to be noticed."""

    def test_a_sharp_gate_sees_its_tolerances_and_little_less(self, tmp_path: Path) -> None:
        """Noise of a hundredth of the tolerance of the mean, a tenth of that of a tile."""
        found = simulate(bank(small(one_gate(tmp_path)), sigma=0.001), 20)
        assert found.endings == ("pass",) * 20 and found.rates.undecided == 0 and not found.rates.flaky
        assert found.rates.share == 0.25
        assert 0.9 * 0.002 < (found.rates.sure_everywhere or 0.0) <= 0.002
        assert 0.7 * 0.05 < (found.rates.sure_patch or 0.0) <= 1.1 * 0.05
        by = {(each.where, each.gain): each for each in found.powers}
        for where, promised in PROMISED.items():
            assert by[where, promised].passed <= 1
            assert by[where, 2 * promised].failed == by[where, 2 * promised].trials == 20

    def test_a_gate_that_tolerates_all_is_blind_to_patches(self, tmp_path: Path) -> None:
        gate = dataclasses.replace(small(one_gate(tmp_path)), tolerance=Tolerance(0.002, 1.0, 1.0))
        found = simulate(bank(gate, sigma=0.001), 10)
        assert not found.rates.sure("patch") and found.rates.sure("everywhere")
        assert [each.passed for each in found.powers if each.where == "patch"] == [10, 10]


@pytest.mark.parametrize("first", range(30))
def test_the_smallest_that_is_seen_is_found_by_few_guesses(first: int) -> None:
    asked: list[int] = []

    def holds(rung: int) -> bool:
        asked.append(rung)
        return rung >= first

    assert first_true(holds, 29, 14) == min(first, 29)
    assert len(set(asked)) == len(asked) <= (4 if 12 < first < 16 else 8)


class TestGather:
    """The banks."""

    def test_hold_replicas_of_both_sides_with_the_same_mean(self, tmp_path: Path) -> None:
        family = load_gates(write(tmp_path, GATES.replace("{ value = [0.5, 0.5, 0.5] }", "{ spp = 1 }")))
        gathered, = gather(family.gates)
        assert len(gathered.test.samples) == BUDGETS * 64 and len(gathered.reference.samples) == 64
        assert gathered.grows
        np.testing.assert_array_equal(gathered.test.means.mean(axis=0), gathered.reference.means.mean(axis=0))

    def test_of_samples_that_are_not_finite_are_refused(self, tmp_path: Path) -> None:
        (tmp_path / "own.frag").write_text(
            """uniform sampler2D pingpong0; uniform int numpass; uniform int samples_per_pass; in vec2 texcoord;
            layout(location = 0) out vec4 sum;
            void main() { sum = vec4(0.5, 0.5, 0.5, 0.0); }""")
        gate = dataclasses.replace(one_gate(tmp_path), test=Tracer("cosine", shader=tmp_path / "own.frag"))
        with pytest.raises(HarnessError, match="samples are not finite, with which the gate fails; mend that first"):
            gather([gate])


def test_a_process_finds_what_is_found_without(tmp_path: Path) -> None:
    gate = small(one_gate(tmp_path))
    family = GatesFile(tmp_path, (gate,), 0.01)
    banks = [bank(gate, sigma=SOME_NOISE)]
    assert run_banks(family, banks, 3, jobs=2) == run_banks(family, banks, 3)
