"""Validate a GLSL Monte-Carlo path tracer against Mitsuba 3: the public names, each loaded when first used."""

from __future__ import annotations

import importlib
from typing import Any

from harness.machine.llvm_beside import point_drjit_at_it

# Public name -> module. Importing the package stays cheap: neither GL nor Mitsuba loads before it is needed.
_HOMES = {
    "Batch": "harness.samples.estimate", "Estimate": "harness.samples.estimate",
    "HarnessError": "harness.errors", "MachineError": "harness.errors",
    "Command": "harness.estimators.command", "Constant": "harness.estimators.constant",
    "Coupled": "harness.estimators.coupled",
    "Images": "harness.estimators.images", "Mitsuba": "harness.estimators.mitsuba",
    "Shader": "harness.estimators.shader", "Tracer": "harness.estimators.tracer",
    "Library": "harness.shader.library",
    "Scene": "harness.scene", "SceneFile": "harness.scene", "load_scene": "harness.scene",
    "Store": "harness.samples.store",
    "StrategyResult": "harness.results", "StudyResult": "harness.results",
    "load_gates": "harness.gates", "run_gate": "harness.gates",
    "estimate": "harness.api", "judge": "harness.policy", "render": "harness.api", "render_reference": "harness.api",
    "read_estimate": "harness.samples.exr", "write_estimate": "harness.samples.exr",
    "study": "harness.studies.study",
    "ParameterStudy": "harness.notebook", "load_parameter_study": "harness.notebook",
    "parameter_study": "harness.notebook",
}
__all__ = sorted(_HOMES)

point_drjit_at_it()


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'harness' has no attribute '{name}'")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
