"""`harness gate`: the tolerance gates of a file, without pytest."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import CacheOption, DeviceOption, ProfileTimeOption, open_store
from harness.cli.output import JsonOption, print_json, print_rich, progress
from harness.errors import HarnessError, MachineError

if TYPE_CHECKING:
    from harness.gates import Gate, References
    from harness.results import GateRecord


def gate(
    file: Annotated[Path, typer.Argument(help="A gates file (.toml).")] = Path("tests/gates.toml"),
    only: Annotated[list[str] | None, typer.Option(
        "--only", metavar="NAME", help="Run this gate, or this entry's; may be given several times.")] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the summary page, and for what gates that "
                                         "do not pass leave behind.")] = Path("reports/out/gates"),
    ladder: Annotated[bool, typer.Option("--ladder/--no-ladder", help="Where a gate fails, run it at max_depth 1, 2, "
                                         "3, ... too, and say from which bounce on it is wrong.")] = True,
    tight: Annotated[bool, typer.Option("--tight", help="Coupled gates alone, with a quarter of their tolerances and "
                                        "four times their samples.")] = False,
    cache: CacheOption = True,
    device: DeviceOption = None,
    profile_time: ProfileTimeOption = False,
    json: JsonOption = False,
) -> int:
    """Run tolerance gates: each draws samples until it is decided or its budget ends.

    The reference is kept in the cache; what is under test is rendered each time. Gates that do not pass leave images,
    maps, curve and numbers in a folder of their name. Exit status 0 when all pass, 1 when one fails or its samples do
    not decide, 2 when one could not be run; the others are run all the same.

    Example: `harness gate --only spheres-mixture`
    """
    from harness import gates
    from harness.files import require_writable
    from harness.gates import runner, summary
    from harness.gates.records import as_json

    family = gates.load_gates(file)
    chosen = family.select(only or [])
    if tight:
        chosen = tuple(item.tightened() for item in chosen if item.agreement is not None)
        if not chosen:
            raise HarnessError(f"{file}: --tight is for coupled gates, and there is none among those chosen; give one "
                               "reference = { coupled = true }")
    for item in chosen:
        runner.check_gate(item)  # a bad one shows before the first is rendered
    require_writable(output / summary.HTML)
    references = gates.References(open_store(cache))
    found: list[GateRecord] = []
    try:
        with progress(len(chosen), file.name) as advance:
            for item in chosen:
                found.append(_run(item, references, output, ladder))
                advance(1)
    finally:  # also of what was done before Ctrl-C
        pages = summary.write_summary(found, output)
    if json:
        print_json({"file": file, "false_alarms": family.false_alarms, "summary": pages,
                    "gates": [as_json(item) for item in found]})
    else:
        _print(found, output)
    if errors := [item.reason for item in found if item.outcome == "error"]:
        others = f" (and {len(errors) - 1} more; see {output / summary.HTML})" if errors[1:] else ""
        raise HarnessError(errors[0] + others)
    return 0 if all(item.outcome == "pass" for item in found) else 1


def _run(gate: Gate, references: References, output: Path, ladder: bool) -> GateRecord:
    """Run one gate and save what it leaves; what keeps this one from running is no reason not to run the others."""
    from harness.gates import artefacts, run_gate

    try:
        result = run_gate(gate, references, progress=progress, ladder=ladder)
    except MachineError:
        raise
    except HarnessError as error:
        artefacts.clear(output / gate.name)
        return artefacts.error_record(gate, error)
    artefacts.save_result(result, output / gate.name, pictures=result.outcome != "pass")
    return artefacts.record(result)


def _print(found: list[GateRecord], output: Path) -> None:
    from rich.table import Table

    from harness.gates.summary import HTML, counted
    from harness.stats.bias import percent

    table = Table(box=None, pad_edge=False)
    for heading in ("gate", "outcome", "mean error", "interval", "tolerance", "spp", "of", "s"):
        table.add_column(heading, justify="left" if heading in ("gate", "outcome") else "right")
    for item in found:
        if item.numbers is None:
            table.add_row(item.gate, item.outcome)
            continue
        numbers = item.numbers
        error, low, high = (percent(value, signed=True) for value in numbers.luminance)
        table.add_row(item.gate, item.outcome, error, f"{low} to {high}",
                      f"±{percent(numbers.tests['mean'].tolerance)}", str(numbers.samples), str(numbers.budget),
                      f"{numbers.seconds:.1f}")
    print_rich(table)
    for item in found:
        if item.outcome != "pass":
            left = f"see {output / item.gate}; " if item.outcome != "error" else ""
            print(f"{item.gate}: {item.outcome}: {item.reason}; {left}{item.command}")
    print(f"{counted(found)}; {output / HTML}")
