"""A calibration made up, with every judgement in it, for tests of what is shown and kept."""

from __future__ import annotations

from dataclasses import replace

from harness.stats.calibration import LEVELS, SUBJECTS, Calibration, FalseAlarms, Power
from harness.stats.suites import BIASES, GatePower, GateRates, SuiteRates


def calibration(excessive: int = 0, failed: int = 2) -> Calibration:
    """Two cases whose alarms are as asked for, and none but `excessive` of 300 of the last test at 1 %; `failed`
    of 1,000 runs of the suite."""
    cases = {"normal / normal": "synthetic, 128 samples per pixel", "box: a / b": "rendered, 128 samples per pixel",
             "normal, to a decision": "synthetic, up to 8192 samples per pixel"}
    alarms = [FalseAlarms(case, subject, level, round(300 * level) if case.startswith("normal") else 0, 300)
              for case in list(cases)[:2] for level in LEVELS for subject in SUBJECTS]
    last = -1 - len(SUBJECTS)  # at 1 %
    alarms[last] = replace(alarms[last], hits=excessive)
    powers = [Power(case, where, gain, tolerance, round(60 * min(gain / (0.01 + tolerance), 1)),
                    round(60 * (gain < tolerance)), 60, 0.75)
              for case, tolerances in (("box: a / b", (0.0, 0.0)), ("normal, to a decision", (0.002, 0.05)))
              for where, gains, tolerance in (("everywhere", (0.0, 0.001, 0.002, 0.03), tolerances[0]),
                                              ("patch", (0.01, 0.05, 0.5), tolerances[1])) for gain in gains]
    cases["coupled: 16 replicas, tight"] = "synthetic, up to 4096 samples per pixel"
    differences = tuple(Power("coupled: 16 replicas, tight", where, gain, tolerance, failed, passed, 60, 0.5)
                        for where, gain, tolerance, failed, passed in (
                            ("everywhere", 0.0, 5e-6, 0, 60), ("everywhere", 1e-5, 5e-6, 57, 0),
                            ("patch", 2.5e-4, 5e-4, 0, 6)))
    return Calibration(cases, tuple(alarms), tuple(powers), suite(failed), {"image size": "60 x 60"}, differences)


def suite(failed: int) -> SuiteRates:
    """A sharp gate, and one that is blind to patches and leaves one good render in a hundred undecided."""
    gates = (GateRates("sharp", failed, 0, 1000, 0.25, 0.002, 0.05, 0.0015, 0.045),
             GateRates("blind", 0, 10, 1000, 0.75, 0.005, 1.0, 0.005, None))
    powers = tuple(GatePower(gate.gate, where, gain, 40 if gate.gate == "sharp" else 0,
                             0 if gate.gate == "sharp" else 90, 100) for gate in gates for where, gain in BIASES)
    return SuiteRates("gates.toml", 0.01, 0.005, 1000, failed, failed + 10, gates, powers)
