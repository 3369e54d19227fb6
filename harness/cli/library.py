"""`harness check-library`: the functions of somebody's shader library, one by one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from harness.cli.options import DeviceOption
from harness.cli.output import JsonOption, print_json, progress

if TYPE_CHECKING:
    from harness.checks.own import Proofs


def check_library(
    folder: Annotated[Path, typer.Argument(help="A folder of shader files that stand in for the harness's of the same "
                                                "name, such as lib/sampling.glsl.", show_default=False)],
    device: DeviceOption = None,
    json: JsonOption = False,
) -> int:
    """Check the functions of a shader library: random numbers, frames, pdfs, samplers, the BRDF, weights.

    No image is rendered: each function is held against its own pdf or formula. Exit status 1 when one is wrong.

    Example: `harness check-library my_glsl`
    """
    found = library_findings(folder)
    if json:
        print_json(library_json(folder, found))
    else:
        for line in library_lines(folder, found):
            print(line)
    return 1 if found.failed else 0


def library_findings(folder: Path) -> Proofs:
    """The checks of a folder's functions, with a progress bar. HarnessError, ShaderError as `check_library`."""
    from harness.checks import own

    with progress(len(own.TOPICS), f"checking {folder}") as advance:
        return own.check_library(folder, advance)


def library_lines(folder: Path, found: Proofs) -> list[str]:
    """What to print: each function that is wrong with its place, in the order in which they build on each other."""
    lines = [f"{each.where or folder}: {each.function}: {each.sentence}" for each in found.failed]
    if len({each.function for each in found.failed}) > 1:
        shared = f"; all of them call {' and '.join(found.shared)}" if found.shared else ""
        lines.append(f"mend them from the top: one further down may be wrong by one above it alone{shared}")
    lines += [f"not checked: {each}" for each in found.unchecked]
    asked = f"{len(found.findings)} checks of {', '.join(found.functions)}"
    wrong = sum(not each.passed for each in found.findings)
    lines.append(f"{asked}: {f'{wrong} failed' if wrong else 'all passed'}")
    return lines


def library_json(folder: Path, found: Proofs) -> dict[str, Any]:
    """The same as one object."""
    return {"library": folder, "passed": not found.failed, "unchecked": found.unchecked, "shared": found.shared,
            "findings": [{"function": each.function, "where": each.where, "check": each.check, "passed": each.passed,
                          "value": each.value, "expected": each.expected, "p": each.p, "error": each.error,
                          "sentence": each.sentence} for each in found.findings]}
