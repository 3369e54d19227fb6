"""`harness study`: convergence curves, verdicts and costs, over scenes, parameters, strategies and other renderers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import (
    CORES,
    MAX_SPP,
    CacheOption,
    ClusterOption,
    ConfidenceOption,
    DepthOption,
    DeviceOption,
    ExecutorOption,
    JobsOption,
    ProfileTimeOption,
    SizeOption,
    not_finite,
    open_executor,
    open_store,
    require_memory,
    scene_file,
    warn_of_other_scene,
)
from harness.cli.output import JsonOption, log, print_json, progress, time_left
from harness.cli.studied import CommandsOption, ImagesOption, IntegratorsOption, ShadersOption, names
from harness.errors import HarnessError, SceneError

if TYPE_CHECKING:
    from harness.estimators.base import Estimator
    from harness.results import StudyResult
    from harness.samples.estimate import Estimate
    from harness.scene import SceneFile


def study(
    scenes: Annotated[list[Path], typer.Argument(help="Mitsuba 3 scene files (.xml).", show_default=False)],
    strategies: Annotated[str | None, typer.Option("--strategies", "-s", metavar="A,B,...", help=(
        "Comma-separated; all that suit the scene if neither these nor anything else is named."))] = None,
    samplers: Annotated[str, typer.Option("--samplers", metavar="A,B,...", help="Each strategy with each of these: "
                                          "independent, sobol.")] = "independent",
    commands: CommandsOption = None,
    shaders: ShadersOption = None,
    images: ImagesOption = None,
    integrators: IntegratorsOption = None,
    timeout: Annotated[float, typer.Option("--timeout", min=0.1, help="Seconds that a run of --command may take.")]
    = 600.0,
    parameters: Annotated[list[str] | None, typer.Option("--set", metavar="NAME=V1,V2,...", help=(
        "Values for a <default> parameter of the scenes, and for what has that name in a --shader or in braces in a "
        "--command; every combination is studied. A value that is several numbers has spaces between them: "
        "'kd=1 0 0,0 1 0'."))] = None,
    spp: Annotated[int, typer.Option("--spp", min=4, max=MAX_SPP // 4, help="Samples per pixel of each replica.")]
    = 1024,
    replicas: Annotated[int, typer.Option("--replicas", min=2, max=1000, help="Independent runs of each.")] = 8,
    reference_spp: Annotated[int | None, typer.Option("--reference-spp", min=2, max=MAX_SPP,
                             help="Samples per pixel of Mitsuba's image; 4 x spp if not given.")] = None,
    reference: Annotated[Path | None, typer.Option("--reference", help="A ready reference (.exr) instead.")] = None,
    error: Annotated[float | None, typer.Option("--error", min=1e-9, help=(
        "RMSE, relative to the image's mean, at which costs are told (0.05: 5 %); one that all reach if not given."))]
    = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help=(
        "Folder to keep the result in: studies and images, table.csv and table.parquet, one number a row, and figures "
        "(.svg)."))] = None,
    size: SizeOption = None,
    max_depth: DepthOption = None,
    tolerance: Annotated[float | None, typer.Option(
        "--tolerance", min=1e-9, max=1.0, help="Bias, relative to the mean, that still counts as equivalent; 0.002 if "
                                                "not given, 0.005 where the reference shows meshes. Tiles have 6.25 "
                                                "and 25 times that.")] = None,
    confidence: ConfidenceOption = 0.95,
    executor: ExecutorOption = "serial",
    cluster: ClusterOption = None,
    jobs: JobsOption = CORES,
    cache: CacheOption = True,
    device: DeviceOption = None,
    profile_time: ProfileTimeOption = False,
    json: JsonOption = False,
) -> int:
    """Measure how each strategy converges to the reference on each scene, and what equal error costs.

    An interrupted study continues where it was. Exit status 1 when a suiting strategy's mean is not judged pass, or
    one of its tiles fails; tiles that are undecided are told with the samples that they would take.

    Several scenes, and several values of parameters (`--set alpha=1,10,100`), are studied in every combination, and
    make one table. Beside our strategies, programs, shaders, images and Mitsuba's integrators may be studied.

    Example: `harness study mitsuba_scenes/spheres.xml --strategies uniform,cosine,mixture --spp 4096 --replicas 8`
    """
    from harness.cli.studied import estimators, notes, require_told_apart
    from harness.cli.study_text import as_json, print_product, print_study
    from harness.studies.parameters import combinations, parse_axes
    from harness.studies.product import study_product
    from harness.studies.remaining import Schedule

    studied = estimators(strategies, commands, shaders, images, integrators, spp, timeout)
    drawn = names("--samplers", samplers, "independent,sobol")
    axes = parse_axes(parameters or ())
    if reference and reference_spp:
        raise HarnessError("--reference-spp is for an image yet to be rendered; leave it out, or --reference")
    bare = [scene_file(scene, size, None, max_depth) for scene in scenes]
    require_told_apart(studied, bare, axes)
    files = combinations(bare, axes, studied)
    _open(files, studied)
    for note in notes(studied, files[0], axes):
        log(note)
    if reference and len(files) > 1:
        raise HarnessError(f"--reference is one image, and {len(files)} combinations are studied; leave it out")
    ready = _open_reference(reference, files[0]) if reference else None
    store = open_store(cache)
    if executor != "serial" and store is None:
        raise HarnessError(f"--executor {executor} hands samples over through the cache; leave out --no-cache")
    kept = None
    if output:
        from harness.files import require_writable
        from harness.studies.kept import PRODUCT_FILE, Kept
        from harness.studies.storage import STUDY_FILE

        require_writable(output / (PRODUCT_FILE if len(files) > 1 else STUDY_FILE))
        kept = Kept(output, product=len(files) > 1)

    def keep(result: StudyResult) -> None:
        _warn(result)
        if kept:
            kept.add(result)

    title = "study" if len(files) == 1 else f"{len(files)} studies"
    with open_executor(executor, jobs, cluster) as workers, time_left(title) as tell:
        product = study_product(
            bare, studied, axes=axes, samplers=drawn, spp=spp, replicas=replicas, reference_spp=reference_spp,
            reference=ready, error=error, schedule=Schedule(tell), keep=keep, tolerance=tolerance,
            confidence=confidence, store=store, executor=workers if executor != "serial" else None, progress=progress)
    if kept and output:
        from harness.report.figures.product import write_figures

        kept.finish(product)
        write_figures(product, output)
    single = len(files) == 1
    if json:
        print_json(as_json(product.studies[0]) if single else
                   {"parameters": dict(product.axes), "studies": [as_json(each) for each in product.studies]})
    elif single:
        print_study(product.studies[0])
    else:
        print_product(product)
    return 0 if product.good else 1


def _open(files: Sequence[SceneFile], studied: Sequence[str | Estimator] | None) -> None:
    """Refuse what cannot be studied; a scene that our tracer does not read may be studied with others. What both sides
    replace is said once for all combinations."""
    from harness.scene import load, present

    told: dict[str, None] = {}
    for file in files:
        try:
            load(file)
        except SceneError:
            if studied is None or any(isinstance(each, str) for each in studied):
                raise
        else:
            told |= dict.fromkeys(f"{file.path}: note: {note}" for note in present(file).notes)
        require_memory(file)
    for note in told:
        log(note)


def _warn(result: StudyResult) -> None:
    """Of strategies that do not suit, and of samples that were rejected."""
    for item in result.strategies:
        if not item.suits:
            log(f"warning: strategy '{item.strategy}': {item.warning}")
        if item.estimate.rejected:
            log(f"warning: strategy '{item.strategy}': {not_finite(item.estimate.rejected)}")


def _open_reference(path: Path, file: SceneFile) -> Estimate:
    from harness.cli.options import scene_hash
    from harness.samples.exr import read_estimate

    estimate, facts = read_estimate(path)
    film = file.film
    if estimate.mean.shape[:2] == (film.height, film.width):  # else the study refuses it
        warn_of_other_scene(scene_hash(file), facts, path)
    return estimate
