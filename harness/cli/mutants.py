"""`harness mutants`: do the gates catch seeded bugs?"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import AUTOPSY_FILE, MUTANTS_FILE, CacheOption, open_store
from harness.cli.output import JsonOption, print_json, print_rich, progress

if TYPE_CHECKING:
    from collections.abc import Sequence

    from harness.mutants.catalogue import Mutant
    from harness.mutants.matrix import KillMatrix
    from harness.results import AutopsyScore

# Shown for each state of a cell.
SYMBOLS = {"killed": "X", "survived": "o", "untouched": "·", "not run": " "}
# The share of the mutants that a scene shows of which an autopsy must name the function.
NAMED = 0.95


def mutants(
    only: Annotated[list[str] | None, typer.Argument(metavar="[ID|TOPIC]...", help="Mutants, or topics such as "
                    "sampling; all if none is given.", show_default=False)] = None,
    gates: Annotated[Path, typer.Option("--gates", help="The gates file to judge.")] = Path("tests/gates.toml"),
    tests: Annotated[Path, typer.Option("--tests", help="Folder of the harness's tests.")] = Path("tests"),
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=1, max=64, help="Processes; one a core if not given.")]
    = os.cpu_count() or 1,
    output: Annotated[Path, typer.Option("--output", "-o", help="JSON file to keep the matrix in, for the report.")]
    = Path("reports/out") / MUTANTS_FILE,
    autopsy: Annotated[bool, typer.Option("--autopsy", help="Ask `harness autopsy` instead of the gates: does it name "
                                          "each bug's function, and accuse no correct shader?")] = False,
    full: Annotated[bool, typer.Option("--full", help="Ask every gate about every mutant, not only until four have "
                                       "killed it, or one of twelve.")] = False,
    cache: CacheOption = True,
    json: JsonOption = False,
) -> int:
    """Seed one-line bugs into the shader and show which gates notice them.

    Prints the kill matrix: X killed, o survived, · the gate's pixels do not change, blank not run, as others had
    killed it. Exit status 1 when a mutant survives all gates; 2 when one does not apply or does not compile. What was
    judged is kept, so that an interrupted run goes on where it was. With --autopsy: what each autopsy names, kept
    beside the matrix; exit status 1 when it names the right function of fewer than 95 % of those that a bundled
    scene shows, or accuses a shader that is right.

    Example: `harness mutants sampling phong`
    """
    from harness.files import require_writable
    from harness.mutants.catalogue import choose, load_catalogue
    from harness.mutants.matrix import as_json, save
    from harness.mutants.runner import Gates, run_mutants

    chosen = choose(load_catalogue(), only or [])
    if autopsy:
        return _autopsy(chosen, jobs, output.with_name(AUTOPSY_FILE) if not only else None, json=json)
    family = Gates.of(gates, tests)
    require_writable(output)
    store = open_store(cache)
    matrix = run_mutants(chosen, family, jobs=min(jobs, len(chosen)), full=full, store=store.root if store else None,
                         progress=progress)
    if not only:  # of some mutants alone the report would say that the others survived
        save(matrix, output)
    if json:
        print_json(as_json(matrix))
    else:
        _print(matrix)
    return 1 if matrix.survivors else 0


def _print(matrix: KillMatrix) -> None:
    from rich.table import Table

    run = [number for number in range(len(matrix.gates)) if any(row[number] != "not run" for row in matrix.cells)]
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("mutant")
    for number in run:
        table.add_column(str(number + 1), justify="right")
    for mutant, row in zip(matrix.mutants, matrix.cells, strict=True):
        table.add_row(mutant.id, *(SYMBOLS[row[number]] for number in run))
    print_rich(table)
    for number in run:
        kills = sum(row[number] == "killed" for row in matrix.cells)
        print(f"{number + 1:3d}  {matrix.gates[number]}: {kills} killed")
    for mutant in matrix.missed:
        print(f"{mutant.id}: not killed by {mutant.killer}, which the catalogue expects, but by another gate")
    for mutant in matrix.survivors:
        print(f"SURVIVES: {mutant.id} ({mutant.where}): {mutant.imitates}")
    if matrix.idle:
        print(f"gates that killed nothing: {', '.join(matrix.idle)}")
    print(f"{len(matrix.mutants) - len(matrix.survivors)} of {len(matrix.mutants)} mutants killed")


def _autopsy(chosen: Sequence[Mutant], jobs: int, keep: Path | None, *, json: bool) -> int:
    """The score of the autopsies; `keep`: where to write it."""
    from harness.files import require_writable
    from harness.mutants.autopsy import as_json, save, score

    if keep:
        require_writable(keep)
    found = score(chosen, jobs=min(jobs, len(chosen)), variants=keep is not None, progress=progress)
    if keep:
        save(found, keep)
    if json:
        print_json(as_json(found))
    else:
        _print_autopsies(found)
    return 1 if found.accused or found.count("named") < NAMED * found.reached else 0


def _print_autopsies(found: AutopsyScore) -> None:
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for title in ("", "mutant", "is in", "named", "stage", "at", "scene", "paths", "CPU s"):
        table.add_column(title)
    for mutant in found.mutants:
        seen = f"{mutant.share:.1%}" if mutant.share else ""
        table.add_row("" if mutant.outcome == "named" else mutant.outcome, mutant.id, " ".join(mutant.wrong[:3]),
                      mutant.named[0] if mutant.named else "", mutant.stage, mutant.place,
                      f"{mutant.scene}:{mutant.strategy}" if mutant.scene else "", seen, f"{mutant.seconds:.2f}")
    print_rich(table)
    for variant in found.accused:
        print(f"ACCUSED although right: {variant.id} on {variant.scene}, {variant.strategy}: {variant.stage}")
    if found.variants:
        print(f"{len({each.id for each in found.variants})} correct shaders, {len(found.variants)} autopsies of them, "
              f"{len(found.accused)} accused")
    print(f"{found.count('named')} of {found.reached} mutants named with their function, "
          f"{found.count('misnamed')} with another, {found.count('missed')} missed; {found.count('unreached')} change "
          "nothing in any bundled scene")
