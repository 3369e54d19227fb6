"""`harness grade`: thirty submissions, a table and a page of evidence each."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

import typer

from harness.cli.check import CausesOption, ValueOption
from harness.cli.options import CacheOption, SizeOption, open_store, parse_size
from harness.cli.output import JsonOption, print_json, print_rich, progress

HintsWord = Literal["none", "place", "family", "formula"]


def grade(
    folder: Annotated[Path, typer.Argument(help="Holds a file or a folder for each submission.", show_default=False)],
    scene: Annotated[str, typer.Option("--scene", metavar="SCENE", help="The Mitsuba scene that they show: a file, or "
                                       "the name of a bundled one.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for grades.csv, index.html and a page each.")]
    = Path("grades"),
    hints: Annotated[HintsWord, typer.Option("--hints", help=(
        "How much the students' pages tell: the verdict alone, where it is wrong too, of what kind the cause is, the "
        "cause itself."))] = "place",
    points: Annotated[float, typer.Option("--points", min=0.01, help="What a right submission is worth.")] = 100.0,
    host: Annotated[str | None, typer.Option("--host", help="The dialect of all, if syntax does not tell it.")] = None,
    values: ValueOption = None,
    size: SizeOption = None,
    budget: Annotated[float, typer.Option("--budget", min=0.5, max=86400.0, help="Seconds for each's frames.")] = 20.0,
    tolerance: Annotated[float | None, typer.Option("--tolerance", min=1e-9, max=1.0, show_default=False, help=(
        "Bias, relative to the mean, that still counts as equivalent."))] = None,
    causes: CausesOption = True,
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=1, max=64, help="Processes; one a core if not given.")]
    = os.cpu_count() or 1,
    cache: CacheOption = True,
    json: JsonOption = False,
) -> int:
    """Grade a folder of shaders: each is judged by itself, in a process with limits, against Mitsuba's picture.

    Writes grades.csv and index.html, which tell the teacher all, and for each submission a page and Gradescope's
    results.json, which tell what --hints allow. Exit status 1 when a submission is not right.

    Example: `harness grade submissions --scene spheres --hints family -o grades`
    """
    from harness.cli.check import parse_values, scene_file
    from harness.files import require_writable, write_atomically
    from harness.grading.grade import Task
    from harness.grading.grade import grade as grade_all
    from harness.grading.sheets import CSV_FILE, sheets
    from harness.grading.submissions import submissions

    found = submissions(folder)
    require_writable(output / CSV_FILE)
    store, (width, height) = open_store(cache), parse_size(size)
    given = tuple(sorted(parse_values(values or ()).items()))
    task = Task(scene_file(scene), host, given, (width, height) if width and height else None, budget, tolerance,
                store.root if store else None, causes)
    grades = grade_all(found, task, jobs=min(jobs, len(found)), progress=progress)
    for name, content in sheets(grades, scene=task.scene.name, hints=hints, points=points).items():
        with write_atomically(output / name) as partial:
            partial.write_bytes(content)
    if json:
        print_json({"scene": task.scene.name, "output": str(output), "grades": [
            {"name": each.name, "outcome": each.outcome, "points": round(points * each.points, 2), "error": each.error,
             "sentence": each.sentence, "place": each.place, "family": each.family, "formula": each.formula,
             "findings": [text for _, text in each.findings], "seconds": round(each.seconds, 1)} for each in grades]})
    else:
        from rich.table import Table

        table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
        for title in ("", "submission", "points", "what there is to say"):
            table.add_column(title)
        for each in grades:
            table.add_row(each.outcome, each.name, f"{points * each.points:.4g}", each.formula or each.sentence)
        print_rich(table)
        print(f"{sum(each.outcome == 'pass' for each in grades)} of {len(grades)} right; {output / 'index.html'}")
    return 0 if all(each.outcome == "pass" for each in grades) else 1
