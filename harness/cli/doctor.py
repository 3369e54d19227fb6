"""`harness doctor`: what this machine lacks, and the line that mends it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from harness.cli.output import JsonOption, print_json, print_rich, progress
from harness.errors import MachineError

if TYPE_CHECKING:
    from harness.machine.doctor import Check


def doctor(json: JsonOption = False) -> int:
    """Show what this machine has and lacks, and the line that mends it.

    Exit status 0 when all that is needed is there, 3 when something is missing.

    Example: `harness doctor --json`
    """
    from harness.machine.doctor import examine

    checks: list[Check] = []
    with progress(None, "Examining this machine") as advance:
        for check in examine():
            checks.append(check)
            advance(1)
    missing = [check for check in checks if check.needed and not check.ok]
    if json:
        print_json({"ok": not missing, "checks": checks})
    else:
        _print_table(checks)
    return MachineError.exit_status if missing else 0


def _print_table(checks: list[Check]) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    for heading in ("", "need", "found"):
        table.add_column(heading)
    for check in checks:
        failed = Text("MISSING", "bold red") if check.needed else Text("low", "yellow")
        mark = Text("ok", "green") if check.ok else failed
        table.add_row(mark, check.name, Text(check.detail if check.ok else f"{check.detail}\nto mend: {check.mend}"))
    print_rich(table)
