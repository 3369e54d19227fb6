"""`harness report`: every scene studied, or read back from the last time, and set as a PDF and an HTML page."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeVar

import typer

from harness.cli.options import (
    AUTOPSY_FILE,
    BENCH_FILE,
    CALIBRATION_FILE,
    MUTANTS_FILE,
    DeviceOption,
    ProfileTimeOption,
    open_scene,
    open_store,
)
from harness.cli.output import JsonOption, log, print_json, progress
from harness.errors import HarnessError, SceneError, StoreError

if TYPE_CHECKING:
    from harness.results import CoupledRecord, Exhibit
    from harness.scene import Scene

Found = TypeVar("Found")


def report(
    profile: Annotated[Literal["quick", "full"], typer.Option(help="quick: minutes; full: hours, finer.")] = "quick",
    scenes: Annotated[list[Path] | None, typer.Argument(help="Scene files; all that come with the harness if none "
                                                        "are given.", show_default=False)] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for report.pdf and report.html.")]
    = Path("reports/out"),
    device: DeviceOption = None,
    profile_time: ProfileTimeOption = False,
    json: JsonOption = False,
) -> int:
    """Study every scene with every strategy that suits it, and set the results as a PDF and an HTML page.

    Without scene files of your own the report also shows the course handout's errors, each measured.

    What was rendered before is read back; an interrupted report continues. Exit status 1 when the verdict on a mean is
    not pass, or a tile fails.

    Example: `harness report --profile quick`
    """
    from harness import bench, calibration
    from harness.files import data_dir, require_writable
    from harness.mutants import autopsy, matrix
    from harness.report import Inputs, build_report
    from harness.studies.causes import causes_file, load_causes
    from harness.studies.memo import remembered_study
    from harness.studies.oracle import load_oracle, oracle_file
    from harness.studies.plan import PROFILES, judged

    began = time.perf_counter()
    loaded = _open_all(scenes or sorted(data_dir("mitsuba_scenes").glob("*.xml")))
    require_writable(output / "report.pdf")
    store = open_store(True)
    results = []
    elapsed = {}
    family = judged(loaded)
    with progress(len(loaded), f"report ({profile})") as advance:
        for scene in loaded:
            scene_began = time.perf_counter()
            result, fresh = remembered_study(scene, PROFILES[profile], family, store, warn=_warn, progress=progress)
            results.append(result)
            if fresh:
                elapsed[scene.name] = time.perf_counter() - scene_began
            advance(1)
    began_coupled = time.perf_counter()
    coupled, fresh = _coupled(loaded)
    if fresh:
        elapsed["the coupled oracle"] = time.perf_counter() - began_coupled
    exhibits: Sequence[Exhibit] = ()
    if not scenes:
        from harness.course.memo import remembered_exhibits

        began_exhibits = time.perf_counter()
        exhibits, fresh = remembered_exhibits(store, warn=_warn, progress=progress)
        if fresh:
            elapsed["the handout's errors"] = time.perf_counter() - began_exhibits
    inputs = Inputs(results, profile, elapsed=elapsed, exhibits=exhibits, coupled=coupled,
                    bench=_left(output / BENCH_FILE, bench.load, None),
                    calibration=_left(output / CALIBRATION_FILE, calibration.load, None),
                    mutants=_left(output / MUTANTS_FILE, matrix.load, None),
                    autopsies=_left(output / AUTOPSY_FILE, autopsy.load, None),
                    oracle=_left(oracle_file(), load_oracle, None),
                    causes=_left(causes_file(), load_causes, None))
    pdf = build_report(inputs, output)
    items = {f"{result.scene} {item.strategy}": item
             for result in results for item in result.strategies if item.suits}
    verdicts = {name: item.outcome for name, item in items.items()}
    lost = [name for name, outcome in verdicts.items() if outcome != "pass"]
    for name in lost:
        failed = items[name].tiles.failed and items[name].verdict.outcome != "fail"
        log(f"warning: {name}: {verdicts[name]}{' in tiles' if failed else ''}")
    if json:
        print_json({"pdf": pdf, "seconds": time.perf_counter() - began, "verdicts": verdicts})
    else:
        print(f"{len(verdicts) - len(lost)} of {len(verdicts)} pairs of scene and strategy pass; "
              f"{time.perf_counter() - began:.0f} s")
        print(pdf)
    return 1 if lost else 0


def _open_all(paths: Sequence[Path]) -> list[Scene]:
    """Every scene of the report: what is wrong with the last one must show before the first one is rendered."""
    from harness.metrics import require_ssim_size

    named: dict[str, Path] = {}
    loaded = []
    for path in paths:
        scene = open_scene(path)
        require_ssim_size(scene.height, scene.width)
        if scene.name in named:
            raise HarnessError(f"{path}: a scene called '{scene.name}' is in the report already ({named[scene.name]}); "
                               "give each scene file its own name")
        named[scene.name] = path
        loaded.append(scene)
    return loaded


def _coupled(scenes: Sequence[Scene]) -> tuple[list[CoupledRecord], bool]:
    """Every scene against the coupled oracle, and whether any was measured now; without those that it cannot follow."""
    from harness.studies.coupled import remembered_coupled

    records: list[CoupledRecord] = []
    measured = False
    with progress(len(scenes), "the same paths by Mitsuba") as advance:
        for scene in scenes:
            try:
                found, fresh = remembered_coupled(scene, warn=_warn)
            except SceneError as error:
                log(f"warning: {error}; the report does not compare its paths")
            else:
                records += found
                measured |= fresh
            advance(1)
    return records, measured


def _left(path: Path, load: Callable[[Path], Found], nothing: Found) -> Found:
    """What another command left beside the report; `nothing` where there is no such file, or none that is readable."""
    if not path.exists():
        return nothing
    try:
        return load(path)
    except StoreError as error:
        log(f"warning: {error}; the report goes without it")
        return nothing


def _warn(message: str) -> None:
    log(f"warning: {message}")
