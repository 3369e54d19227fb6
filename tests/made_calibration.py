"""A calibration made up, with every judgement in it, for tests of what is shown and kept."""

from __future__ import annotations

from dataclasses import replace

from harness.stats.calibration import LEVELS, SUBJECTS, Calibration, FalseAlarms, Power


def calibration(excessive: int = 0) -> Calibration:
    """Two cases whose alarms are as asked for, and none but `excessive` of 300 of the last test at 1 %."""
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
    return Calibration(cases, tuple(alarms), tuple(powers), {"image size": "60 x 60"})
