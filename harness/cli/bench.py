"""`harness bench`: the tracer against Mitsuba on the same cores, in one run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import BENCH_FILE, DeviceOption
from harness.cli.output import JsonOption, print_json, print_rich, progress


def bench(
    rounds: Annotated[int, typer.Option(min=2, max=1000, help="Measurements of each pair.")] = 7,
    output: Annotated[Path, typer.Option("--output", "-o", help="JSON file to keep the result in, for the report.")]
    = Path("reports/out") / BENCH_FILE,
    device: DeviceOption = None,
    json: JsonOption = False,
) -> int:
    """Measure the tracer's speed against Mitsuba's, and what features cost, interleaved, by the clock of each
    one's device: CPU time, or the GPU's own.

    Exit status 1 when a median ratio misses what the design needs.

    Example: `harness bench --rounds 11`
    """
    from rich.table import Table

    from harness import bench as benchmark
    from harness.files import require_writable

    require_writable(output)
    rows = benchmark.run(rounds=rounds, progress=progress)
    benchmark.save(rows, output)
    if json:
        print_json({"rows": rows, "output": output})
    else:
        table = Table(box=None, pad_edge=False)
        for heading in ("scene", "strategy", "against", "Ms/s", "other", "ratio", "spread", "needed",
                        "wall ratio", "efficiency"):
            table.add_column(heading, justify="left" if heading in ("scene", "strategy", "against") else "right")
        for row in rows:
            table.add_row(row.scene, row.strategy, row.opponent, f"{row.tracer_rate:.1f}", f"{row.opponent_rate:.2f}",
                          f"{row.ratio:.2f}x", f"{row.low:.2f}-{row.high:.2f}", f"{row.needed:g}x",
                          f"{row.wall_ratio:.2f}x", f"{row.efficiency_ratio:.2f}x")
        print_rich(table)
    return 0 if all(row.ratio >= row.needed for row in rows) else 1
