"""`harness causes`: how often a diagnosis names the cause, and whether it accuses what is right."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import CacheOption, open_store, scene_file
from harness.cli.output import JsonOption, print_json, print_rich, progress

if TYPE_CHECKING:
    from harness.studies.causes import CausesFile

# The scenes that are asked for unless others are named.
SCENES = ("spheres", "cornell", "textures")


def causes(
    scenes: Annotated[list[Path] | None, typer.Argument(metavar="[SCENE]...", help="Mitsuba 3 scene files; "
                                                        f"{', '.join(SCENES)} if none is given.")] = None,
    spp: Annotated[int, typer.Option("--spp", min=32, max=65536, help="Samples per pixel of each stranger's "
                                     "picture.")] = 256,
    seed: Annotated[int, typer.Option("--seed", min=0, max=9999, help="Of the strangers' random numbers.")] = 1,
    output: Annotated[Path, typer.Option("--output", "-o", help="JSON file to keep the result in, written after each "
                                         "scene.")] = Path("reports/out/causes.json"),
    cache: CacheOption = True,
    json: JsonOption = False,
) -> int:
    """Present every defect of the catalogue as a stranger's picture, and count how often its cause is named.

    Strangers have another generator, basis or order of numbers, and where the picture does not depend on it another
    strategy. Shaders that are right are presented too. What was drawn is kept, so the same command goes on where it was
    interrupted. Exit status 1 where a right one is accused.

    Example: `harness causes mitsuba_scenes/spheres.xml`
    """
    from harness.files import data_dir, require_writable
    from harness.mutants.variants import load_variants
    from harness.shader.library import OURS
    from harness.studies.causes import measure_causes, save_causes

    files = [scene_file(path) for path in scenes or [data_dir("mitsuba_scenes") / f"{name}.xml" for name in SCENES]]
    require_writable(output)
    right = {"ours": OURS, **{variant.id: variant.applied() for variant in load_variants()}}
    with progress(len(files), "causes") as advance:
        found = measure_causes(files, right, spp=spp, seed=seed, store=open_store(cache),
                               keep=lambda so_far: save_causes(so_far, output), advance=advance)
    if json:
        print_json({"file": output, **vars(found)})
    else:
        _print(found)
    return 1 if any(record.accused for record in found.records) else 0


def _print(found: CausesFile) -> None:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for number, name in enumerate(("scene", "strangers", "visible", "first", "among three", "right", "accused",
                                   "CPU s")):
        table.add_column(name, justify="right" if number else "left")
    for each in found.records:
        shares = (f"{count} ({count / max(each.visible, 1):.1%})" for count in (each.first, each.three))
        table.add_row(each.scene, str(each.presented), str(each.visible), *shares, str(each.right),
                      str(len(each.accused)), f"{each.seconds:.0f}")
    print_rich(table)
    for each in found.records:
        for one in each.missed:
            place = f"{one.rank} of three" if one.rank else "none of three"
            print(f"{each.scene}: {one.defect} ({one.strategy}, {one.disguise}): {place}; first: {one.told or 'none'}")
        for right in each.accused:
            print(f"{each.scene}: right, and accused: {right.shader} ({right.strategy}): {right.told or right.outcome}")
