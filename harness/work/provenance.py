"""The versions of all that numbers depend on."""

from __future__ import annotations

import platform
from functools import cache
from importlib import metadata

from harness.gpu.context import describe_gl


def versions() -> dict[str, str]:
    """Versions of all that numbers depend on: packages, Python, the GL driver."""
    return {**_packages(), "python": platform.python_version(), **describe_gl()}


@cache
def _packages() -> dict[str, str]:
    """Read once: each is a file somewhere, and a report asks a hundred times."""
    names = ("glsl-validation-harness", "mitsuba", "drjit", "moderngl", "numpy", "scikit-image", "flip-evaluator")
    return {name: metadata.version(name) for name in names}
