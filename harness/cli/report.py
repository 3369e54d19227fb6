"""`harness report`: every scene studied, or read back from the last time, and set as a PDF and an HTML page."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from functools import partial
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
    from harness.results import CoupledRecord, Exhibit, FeatureImage, KeptPicture
    from harness.samples.store import Store
    from harness.scene import Scene
    from harness.studies.ahead import Part
    from harness.studies.plan import Profile

Found = TypeVar("Found")
MAX_JOBS = 8  # a process takes half a gigabyte
COUPLED, ORACLE, EXHIBITS = "against the coupled oracle", "the coupled oracle", "the handout's errors"
FEATURES = "without a feature"
# What a report of a single scene is made of.
PARTS_OF_A_SCENE = 3


def report(
    profile: Annotated[Literal["quick", "full"], typer.Option(help="quick: minutes; full: hours, finer.")] = "quick",
    scenes: Annotated[list[Path] | None, typer.Argument(help="Scene files; all that come with the harness if none "
                                                        "are given.", show_default=False)] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for report.pdf and report.html.")]
    = Path("reports/out"),
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=1, max=256, help="Scenes studied at a time, each in "
                                      "a process; one a core, but eight at most, if not given.")]
    = min(os.cpu_count() or 1, MAX_JOBS),
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
    from harness.files import cache_dir, data_dir, require_writable
    from harness.gates.evidence import evidence
    from harness.mutants import autopsy, matrix
    from harness.report import Inputs, build_report
    from harness.report.chapters.features import sides_of
    from harness.report.inputs import GATES_FOLDER
    from harness.samples.inventory import PAGES, UNUSED, prune_made
    from harness.samples.memo import seconds_to_make
    from harness.studies.ahead import make_ahead
    from harness.studies.causes import causes_file, load_causes
    from harness.studies.coupled import coupled_folder
    from harness.studies.features import features_folder
    from harness.studies.memo import remembered_study, study_folder
    from harness.studies.oracle import load_oracle, oracle_file
    from harness.studies.plan import PROFILES, judged

    began = time.perf_counter()
    loaded = _open_all(scenes or sorted(data_dir("mitsuba_scenes").glob("*.xml")))
    require_writable(output / "report.pdf")
    store = open_store(True)
    results = []
    family = judged(loaded, PROFILES[profile])
    parts = _absent(loaded, PROFILES[profile], family, store, exhibits=not scenes)
    # The parts of a single scene gain less than processes cost, and have a bar that moves by batches.
    if jobs > 1 and len(parts) > PARTS_OF_A_SCENE and store:
        make_ahead(parts, jobs, progress)
    # Of what is read back, too: the report is then the same as when all was new.
    took: dict[str, float | None] = {}
    with progress(len(loaded), f"report ({profile})") as advance:
        for scene in loaded:
            results.append(remembered_study(scene, PROFILES[profile], family, store, warn=_warn, progress=progress)[0])
            took[scene.name] = seconds_to_make(study_folder(scene, PROFILES[profile], family))
            advance(1)
    coupled: list[CoupledRecord] = []
    oracle = []
    with progress(len(loaded), "the same paths by Mitsuba") as advance:
        for scene in loaded:
            if found := _coupled(scene):
                coupled += found
                oracle.append(seconds_to_make(coupled_folder(scene)))
            advance(1)
    features: list[FeatureImage] = []
    for scene in loaded:
        if found_sides := _features(scene, store):
            features += found_sides
            seconds = seconds_to_make(features_folder(scene, sides_of(scene.name))) or 0.0
            took[scene.name] = (took[scene.name] or 0.0) + seconds
    exhibits: Sequence[Exhibit] = ()
    if not scenes:
        from harness.course.memo import exhibits_folder, remembered_exhibits

        exhibits = remembered_exhibits(store, warn=_warn, progress=progress)[0]
        took[EXHIBITS] = seconds_to_make(exhibits_folder())
    took[ORACLE] = sum(filter(None, oracle)) or None
    elapsed = {name: seconds for name, seconds in took.items() if seconds is not None}
    inputs = Inputs(results, profile, elapsed=elapsed, exhibits=exhibits, coupled=coupled,
                    bench=_left(output / BENCH_FILE, bench.load, None),
                    calibration=_left(output / CALIBRATION_FILE, calibration.load, None),
                    mutants=_left(output / MUTANTS_FILE, matrix.load, None),
                    autopsies=_left(output / AUTOPSY_FILE, autopsy.load, None),
                    oracle=_left(oracle_file(), load_oracle, None),
                    causes=_left(causes_file(), load_causes, None), gates=evidence(output / GATES_FOLDER, _warn),
                    pictures=() if scenes else _pictures(), features=features)
    pdf = build_report(inputs, output)
    prune_made(cache_dir(), older=UNUSED, kinds=PAGES)
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


def _absent(scenes: Sequence[Scene], profile: Profile, family: int, store: Store | None, *,
            exhibits: bool) -> list[Part]:
    """What the report needs and the cache lacks, in the order of the report."""
    from harness.course.memo import exhibits_folder, remembered_exhibits
    from harness.course.storage import WORDS_FILE
    from harness.report.chapters.features import sides_of
    from harness.report.inputs import stems_of
    from harness.studies.ahead import Part
    from harness.studies.coupled import RECORDS_FILE, coupled_folder
    from harness.studies.features import IMAGES_FILE, features_folder
    from harness.studies.memo import study_folder
    from harness.studies.plan import exhibited
    from harness.studies.storage import STUDY_FILE

    def drawn(scene: Scene) -> float:
        return float(scene.width * scene.height * (len(exhibited(scene, profile)) + 1) * scene.max_depth)

    stems = stems_of(scene.name for scene in scenes)
    parts = [Part(scene.name, drawn(scene), partial(_chapter_ahead, scene, profile, family, store, stem, len(scenes)))
             for scene, stem in zip(scenes, stems, strict=True)
             if not (study_folder(scene, profile, family) / STUDY_FILE).exists()]
    parts += [Part(f"{scene.name} {COUPLED}", drawn(scene) / 10, partial(_coupled, scene))
              for scene in scenes if not (coupled_folder(scene) / RECORDS_FILE).exists()]
    parts += [Part(f"{scene.name} {FEATURES}", drawn(scene) / 100, partial(_features, scene, store)) for scene in scenes
              if sides_of(scene.name) and not (features_folder(scene, sides_of(scene.name)) / IMAGES_FILE).exists()]
    if exhibits and not (exhibits_folder() / WORDS_FILE).exists():
        parts.append(Part(EXHIBITS, max((part.work for part in parts), default=1.0),
                          partial(remembered_exhibits, store, warn=_warn), fragments=True))
    return parts


def _chapter_ahead(scene: Scene, profile: Profile, family: int, store: Store | None, stem: str, scenes: int) -> None:
    """The study of a scene, and the chapter on it: its maps and pictures take seconds, too."""
    from harness.report.chapters.scenes import chapters_of
    from harness.samples.spent import spent
    from harness.studies.memo import remembered_study

    result, _ = remembered_study(scene, profile, family, store, warn=_warn)
    with spent("chapters"):
        chapters_of(result, stem, scenes)


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


def _coupled(scene: Scene) -> tuple[CoupledRecord, ...]:
    """A scene against the coupled oracle; nothing where that cannot follow it."""
    from harness.studies.coupled import remembered_coupled

    try:
        return remembered_coupled(scene, warn=_warn)[0]
    except SceneError as error:
        log(f"warning: {error}; the report does not compare its paths")
        return ()


def _features(scene: Scene, store: Store | None) -> tuple[FeatureImage, ...]:
    """What the chapter on features shows of a scene besides its study."""
    from harness.report.chapters.features import sides_of
    from harness.studies.features import remembered_features

    sides = sides_of(scene.name)
    return remembered_features(scene, sides, store, warn=_warn)[0] if sides else ()


def _pictures() -> list[tuple[KeptPicture, bytes]]:
    """The handout's, as they come with the harness."""
    from harness.course.kept import kept_folder, load_kept

    folder = kept_folder()
    return [(record, (folder / record.file).read_bytes()) for record in load_kept(folder)]


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
