"""Tolerance gates: comparisons with the reference, held as data in a TOML file and run until they are decided."""

from harness.gates.model import Gate, GateResult, GatesFile
from harness.gates.parser import load_gates
from harness.gates.references import References
from harness.gates.runner import run_gate

__all__ = ["Gate", "GateResult", "GatesFile", "References", "load_gates", "run_gate"]
