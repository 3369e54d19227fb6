"""The chapters of the report, one module each: found by being here, ordered by their `PLACE`.

A module has `PLACE`, a number, and `chapters(inputs)`, which yields what it has to say: no chapter where nothing was
measured, one, or one a scene. To add a chapter, add a file.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pkgutil import iter_modules

from harness.report.blocks import Chapter
from harness.report.inputs import Inputs


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """All chapters that the inputs have something for, in the order of the report."""
    modules = [import_module(f"{__name__}.{found.name}") for found in iter_modules(__path__)]
    for module in sorted(modules, key=lambda module: (module.PLACE, module.__name__)):
        yield from module.chapters(inputs)
