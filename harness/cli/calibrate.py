"""`harness calibrate`: how often the verdicts err, measured on pairs that agree and on pairs that do not."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import CALIBRATION_FILE
from harness.cli.output import JsonOption, print_json, print_rich, progress


def calibrate(
    comparisons: Annotated[int, typer.Option(min=20, max=100_000, help="Null comparisons of each case.")] = 300,
    output: Annotated[Path, typer.Option("--output", "-o", help="JSON file to keep the result in, for the report.")]
    = Path("reports/out") / CALIBRATION_FILE,
    json: JsonOption = False,
) -> int:
    """Measure how often the verdicts err: false alarms with light and heavy tails, and power.

    Exit status 1 when some rate of false alarms lies above the one that was asked for.

    Example: `harness calibrate --comparisons 300`
    """
    from rich.table import Table

    from harness import calibration
    from harness.files import require_writable
    from harness.stats.calibration import SUBJECTS, by_case

    require_writable(output)
    result = calibration.calibrate(comparisons, progress=progress)
    calibration.save(result, output)
    excessive = [alarms for alarms in result.alarms if alarms.judgement == "excessive"]
    if json:
        print_json({"alarms": [{**vars(alarms), "judgement": alarms.judgement} for alarms in result.alarms],
                    "powers": result.powers, "output": output})
    else:
        table = Table(box=None, pad_edge=False)
        table.add_column("false alarms of")
        for name in ("at most", *SUBJECTS):
            table.add_column(name, justify="right")
        for case, levels in by_case(result.alarms).items():
            for level, row in levels.items():
                table.add_row(case, f"{level:g}", *(f"{alarms.rate.value:.4f}" for alarms in row))
        print_rich(table)
        for alarms in excessive:
            low, high = alarms.rate.interval()
            print(f"{alarms.case}, {alarms.subject}: {alarms.hits} of {alarms.trials} alarms, a rate of {low:.4f} to "
                  f"{high:.4f}, where {alarms.level:g} was asked for")
    return 1 if excessive else 0
