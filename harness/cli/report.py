"""`harness report`: every scene studied, or read back from the last time, and set as a PDF and an HTML page."""

from __future__ import annotations

import hashlib
import json as json_module
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeVar

import typer

from harness.cli.options import BENCH_FILE, CALIBRATION_FILE, MUTANTS_FILE, open_scene, open_store
from harness.cli.output import JsonOption, log, print_json, progress
from harness.errors import HarnessError, StoreError

if TYPE_CHECKING:
    from harness.results import Exhibit, StudyResult
    from harness.scene import Scene
    from harness.studies.plan import Profile

Found = TypeVar("Found")

# What a study's numbers depend on besides its scene and settings: the code that makes them.
_CODE = ("samples", "metrics.py", "policy.py", "work", "studies", "results.py", "scene", "stats", "shader", "gpu",
         "reference", "course")


def report(
    profile: Annotated[Literal["quick", "full"], typer.Option(help="quick: minutes; full: hours, finer.")] = "quick",
    scenes: Annotated[list[Path] | None, typer.Argument(help="Scene files; all that come with the harness if none "
                                                        "are given.", show_default=False)] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for report.pdf and report.html.")]
    = Path("reports/out"),
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
    from harness.mutants import matrix
    from harness.report import Inputs, build_report
    from harness.studies.plan import PROFILES, judged

    began = time.perf_counter()
    loaded = _open_all(scenes or sorted(data_dir("mitsuba_scenes").glob("*.xml")))
    require_writable(output / "report.pdf")
    results = []
    elapsed = {}
    family = judged(loaded)
    with progress(len(loaded), f"report ({profile})") as advance:
        for scene in loaded:
            scene_began = time.perf_counter()
            result, fresh = _studied(scene, PROFILES[profile], family)
            results.append(result)
            if fresh:
                elapsed[scene.name] = time.perf_counter() - scene_began
            advance(1)
    exhibits: Sequence[Exhibit] = ()
    if not scenes:
        began_exhibits = time.perf_counter()
        exhibits, fresh = _exhibited()
        if fresh:
            elapsed["the handout's errors"] = time.perf_counter() - began_exhibits
    inputs = Inputs(results, profile, elapsed=elapsed, exhibits=exhibits,
                    bench=_left(output / BENCH_FILE, bench.load, []),
                    calibration=_left(output / CALIBRATION_FILE, calibration.load, None),
                    mutants=_left(output / MUTANTS_FILE, matrix.load, None))
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


def _left(path: Path, load: Callable[[Path], Found], nothing: Found) -> Found:
    """What another command left beside the report; `nothing` where there is no such file, or none that is readable."""
    if not path.exists():
        return nothing
    try:
        return load(path)
    except StoreError as error:
        log(f"warning: {error}; the report goes without it")
        return nothing


def _studied(scene: Scene, profile: Profile, family: int) -> tuple[StudyResult, bool]:
    """The study of one scene, and whether it was made now.

    It is read back where scene, settings and code are the same as when it was made, and as many verdicts (`family`)
    share the rate of false alarms.
    """
    from harness.files import cache_dir
    from harness.scene import describe
    from harness.studies.plan import exhibited_strategies
    from harness.studies.storage import STUDY_FILE, load_study, save_study
    from harness.studies.study import study
    from harness.work.provenance import versions

    key = {"scene": scene.content_hash, "name": scene.name, "exposure": scene.exposure, "notes": scene.notes,
           "strategies": exhibited_strategies(scene),
           "description": describe(scene.path) if scene.path else "", "spp": profile.spp, "replicas": profile.replicas,
           "reference_spp": profile.reference_spp, "family": family, "code": _code_hash(), **versions()}
    digest = hashlib.sha256(json_module.dumps(key, sort_keys=True).encode()).hexdigest()[:24]
    folder = cache_dir() / "studies" / digest
    if (folder / STUDY_FILE).exists():
        try:
            return load_study(folder), False
        except StoreError as error:
            log(f"warning: {error.args[0].partition(';')[0]}; the study is made again")
    result = study(scene, exhibited_strategies(scene), spp=profile.spp, replicas=profile.replicas,
                   reference_spp=profile.reference_spp, family=family, store=open_store(True), progress=progress)
    save_study(result, folder)
    return result, True


def _exhibited() -> tuple[Sequence[Exhibit], bool]:
    """The handout's errors, and whether they were measured now: read back where the code is the same."""
    from harness.course import load_exhibits, measure_exhibits, save_exhibits
    from harness.files import cache_dir
    from harness.work.provenance import versions

    key = json_module.dumps({"code": _code_hash(), **versions()}, sort_keys=True)
    folder = cache_dir() / "exhibits" / hashlib.sha256(key.encode()).hexdigest()[:24]
    if folder.exists():
        try:
            return load_exhibits(folder), False
        except StoreError as error:
            log(f"warning: {error.args[0].partition(';')[0]}; the exhibits are measured again")
    exhibits = measure_exhibits(open_store(True), progress)
    save_exhibits(exhibits, folder)
    return exhibits, True


def _code_hash() -> str:
    import harness
    from harness.files import data_dir

    package = Path(harness.__file__).parent if harness.__file__ else None
    if package is None:
        raise HarnessError("the harness package has no folder; install it as a normal package")
    digest = hashlib.sha256()
    roots = [package / name for name in _CODE] + [data_dir("glsl")]
    for root in roots:
        for file in sorted(root.rglob("*")) if root.is_dir() else [root]:
            if file.suffix in (".py", ".glsl", ".frag"):
                digest.update(file.read_bytes())
    return digest.hexdigest()
