"""`harness oracle`: the coupled oracle against Mitsuba's own `path`, at length."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import CacheOption, open_store, scene_file
from harness.cli.output import JsonOption, print_json, print_rich, progress

if TYPE_CHECKING:
    from harness.studies.oracle import OracleFile


def oracle(
    scenes: Annotated[list[Path] | None, typer.Argument(metavar="[SCENE]...", help="Mitsuba 3 scene files; all that "
                                                        "come with the harness if none is given.")] = None,
    strategy: Annotated[str, typer.Option("--strategy", help="How the oracle draws directions.")] = "mixture",
    seconds: Annotated[float, typer.Option("--seconds", min=0.1, max=1e6, help="CPU seconds of each scene.")] = 60.0,
    output: Annotated[Path, typer.Option("--output", "-o", help="JSON file to keep the result in, written after each "
                                         "scene.")] = Path("reports/out/oracle.json"),
    cache: CacheOption = True,
    json: JsonOption = False,
) -> int:
    """Hold the coupled oracle against Mitsuba's path integrator, each with random numbers of its own.

    Coupled gates cannot see what the oracle and the tracer have in common: the generator, and the directions made of
    its numbers. This looks for it, as sharply as the time allows. What was drawn is kept, so the same command goes on
    where it was interrupted, and one with more seconds adds to it (up to 256; with more, replicas are longer and
    others). Exit status 1 where the two differ by more than chance explains.

    Example: `harness oracle mitsuba_scenes/spheres.xml --seconds 120`
    """
    from harness.files import data_dir, require_writable
    from harness.studies.oracle import measure_oracle, save_oracle

    files = [scene_file(path) for path in scenes or sorted(data_dir("mitsuba_scenes").glob("*.xml"))]
    require_writable(output)
    with progress(len(files), "oracle and path") as advance:
        found = measure_oracle(files, strategy, seconds, open_store(cache),
                               keep=lambda so_far: save_oracle(so_far, output), advance=advance)
    if json:
        print_json({"file": output, **vars(found)})
    else:
        _print(found)
    return 0 if all(record.agrees for record in found.records) else 1


def _print(found: OracleFile) -> None:
    from rich.table import Table

    from harness.stats.bias import percent

    table = Table(box=None, pad_edge=False)
    for number, name in enumerate(("scene", "oracle spp", "path spp", "mean error", "interval", "z of the mean",
                                   "larger", "smaller", "agrees", "CPU s")):
        table.add_column(name, justify="right" if number else "left")
    for each in found.records:
        error, low, high = (percent(value, signed=True) for value in each.error)
        sizes = (f"{tiles.deviate:+.1f} of {tiles.critical:.1f}" for tiles in (each.mean, each.coarse, each.fine))
        table.add_row(each.scene, str(each.spp[0]), str(each.spp[1]), error, f"{low} to {high}", *sizes,
                      "yes" if each.agrees else "no", f"{each.seconds:.0f}")
    print_rich(table)
