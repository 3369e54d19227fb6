"""`harness bench`: the tracer against Mitsuba on the same cores, in one run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import BENCH_FILE, DeviceOption, ProfileTimeOption
from harness.cli.output import JsonOption, print_json, print_rich, progress

if TYPE_CHECKING:
    from rich.table import Table


def bench(
    rounds: Annotated[int, typer.Option(min=2, max=1000, help="Measurements of each pair.")] = 7,
    output: Annotated[Path, typer.Option("--output", "-o", help="JSON file to keep the result in, for the report.")]
    = Path("reports/out") / BENCH_FILE,
    device: DeviceOption = None,
    profile_time: ProfileTimeOption = False,
    json: JsonOption = False,
) -> int:
    """Measure the tracer's speed against Mitsuba's, and what features cost, interleaved, by the clock of each
    one's device: CPU time, or the GPU's own. Against Mitsuba by its fragment and its compute shader, each in a
    process of its own.

    A second table is about error, on every bundled scene: how soon the tracer reaches the same one with each of its
    strategies and samplers, as a multiple of Mitsuba's path integrator with the best of Mitsuba's samplers.

    Exit status 1 when a median ratio misses what the design needs.

    Example: `harness bench --rounds 11`
    """
    from harness import bench as benchmark
    from harness import rivals
    from harness.files import require_writable
    from harness.gpu.width import ask
    from harness.results import Benchmark

    ask()
    require_writable(output)
    found = Benchmark(tuple(benchmark.run(rounds=rounds, progress=progress)),
                      tuple(rivals.run(replicas=max(4, rounds), progress=progress)))
    benchmark.save(found, output)
    if json:
        print_json({"rows": found.rows, "entrants": found.entrants, "output": output})
    else:
        print_rich(_table(
            ("scene", "strategy", "entry", "against"),
            ("Ms/s", "other", "ratio", "spread", "needed", "wall ratio", "efficiency"),
            [(row.scene, row.strategy, row.entry, row.opponent, f"{row.tracer_rate:.1f}", f"{row.opponent_rate:.2f}",
              f"{row.ratio:.2f}x", f"{row.low:.2f}-{row.high:.2f}", f"{row.needed:g}x", f"{row.wall_ratio:.2f}x",
              f"{row.efficiency_ratio:.2f}x") for row in found.rows]))
        print_rich(_table(
            ("scene", "renderer", "strategy", "sampler"), ("as soon", "95 %", "best"),
            [(row.scene, row.renderer, row.strategy, row.sampler, f"{row.ratio:.2f}x",
              f"{row.low:.2f}-{row.high:.2f}", "best" if row.best else "") for row in found.entrants]))
    return 0 if all(row.ratio >= row.needed for row in found.rows) else 1


def _table(words: Sequence[str], numbers: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """A table without frames, its numbers to the right."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for heading in (*words, *numbers):
        table.add_column(heading, justify="left" if heading in words else "right")
    for row in rows:
        table.add_row(*row)
    return table
