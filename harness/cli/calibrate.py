"""`harness calibrate`: how often the verdicts err, measured on pairs that agree and on pairs that do not."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import CALIBRATION_FILE, CacheOption, open_store
from harness.cli.output import JsonOption, print_json, print_rich, progress

if TYPE_CHECKING:
    from harness.stats.calibration import FalseAlarms, Power
    from harness.stats.suites import SuiteRates


def calibrate(
    comparisons: Annotated[int, typer.Option(min=20, max=100_000, help="Null comparisons of each case.")] = 300,
    gates: Annotated[Path, typer.Option("--gates", metavar="FILE", help="The gates file (.toml) whose runs are "
                                        "simulated.")] = Path("tests/gates.toml"),
    runs: Annotated[int, typer.Option(min=100, max=100_000, help="Simulated runs of the gates file.")] = 1000,
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=1, max=64, help="Processes that simulate; one a core if not "
                                      "given.")] = os.cpu_count() or 1,
    output: Annotated[Path, typer.Option("--output", "-o", help="JSON file to keep the result in, for the report.")]
    = Path("reports/out") / CALIBRATION_FILE,
    cache: CacheOption = True,
    json: JsonOption = False,
) -> int:
    """Measure how often the verdicts err: false alarms with light and heavy tails, and power.

    First of the gates of a file as they stand: runs of all are simulated with replicas drawn from a bank, on good
    renders and on biased ones. Then of verdicts on pairs of estimates. Exit status 1 when some rate of false alarms
    lies above the one that was asked for.

    Example: `harness calibrate --comparisons 300`
    """
    from harness import calibration
    from harness.files import require_writable
    from harness.gates import load_gates

    family = load_gates(gates)
    require_writable(output)
    result = calibration.calibrate(family, comparisons, runs, store=open_store(cache), jobs=jobs,
                                   progress=progress)
    calibration.save(result, output)
    excessive = [alarms for alarms in result.alarms if alarms.judgement == "excessive"]
    if json:
        print_json({"alarms": [{**vars(alarms), "judgement": alarms.judgement} for alarms in result.alarms],
                    "powers": result.powers, "coupled": result.coupled, "suite": result.suite, "output": output})
    else:
        _print_alarms(result.alarms, excessive)
        _print_coupled(result.coupled)
        _print_suite(result.suite)
    return 1 if excessive or result.suite.excessive else 0


def _print_alarms(alarms: Sequence[FalseAlarms], excessive: Sequence[FalseAlarms]) -> None:
    from rich.table import Table

    from harness.stats.calibration import SUBJECTS, by_case

    table = Table(box=None, pad_edge=False)
    table.add_column("false alarms of")
    for name in ("at most", *SUBJECTS):
        table.add_column(name, justify="right")
    for case, levels in by_case(alarms).items():
        for level, row in levels.items():
            table.add_row(case, f"{level:g}", *(f"{each.rate.value:.4f}" for each in row))
    print_rich(table)
    for each in excessive:
        low, high = each.rate.interval()
        print(f"{each.case}, {each.subject}: {each.hits} of {each.trials} alarms, a rate of {low:.4f} to {high:.4f}, "
              f"where {each.level:g} was asked for")


def _print_coupled(powers: Sequence[Power]) -> None:
    """What became of biased renders whose reference draws the same random numbers; nothing where none was judged."""
    from rich.table import Table

    if not powers:
        return
    table = Table(box=None, pad_edge=False)
    for number, name in enumerate(("bias", "where", "relative", "passed", "failed", "of", "budget")):
        table.add_column(name, justify="right" if number > 1 else "left")
    for each in powers:
        table.add_row(each.case, each.where, f"{each.gain:.1e}", str(each.passed), str(each.failed), str(each.trials),
                      f"{100 * each.share:.0f} %")
    print_rich(table)


def _print_suite(suite: SuiteRates) -> None:
    from rich.table import Table

    from harness.gates.summary import percent

    table = Table(box=None, pad_edge=False)
    for number, name in enumerate(("gate", "failed", "undecided", "budget", "sure from", "in a patch")):
        table.add_column(name, justify="right" if number else "left")
    for each in suite.gates:
        table.add_row(each.gate, str(each.failed), str(each.undecided), f"{100 * each.share:.0f} %",
                      *("-" if smallest is None else percent(smallest)
                        for smallest in (each.sure_everywhere, each.sure_patch)))
    print_rich(table)
    low, high = suite.alarms.interval()
    print(f"{suite.file}, {suite.runs} simulated runs on good renders: a gate failed in {suite.failed}, a rate of "
          f"{low:.4f} to {high:.4f}, where {suite.false_alarms:g} was asked for; some gate did not pass in {suite.red}")
