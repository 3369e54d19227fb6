"""`harness study`: convergence curves, verdicts and costs of several strategies on one scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    SceneArgument,
    SetOption,
    SizeOption,
    not_finite,
    open_executor,
    open_scene,
    open_store,
    scene_file,
    warn_of_other_scene,
)
from harness.cli.output import JsonOption, log, print_json, print_rich, progress
from harness.errors import HarnessError

if TYPE_CHECKING:
    from harness.results import StrategyResult, StudyResult
    from harness.samples.estimate import Estimate
    from harness.scene import Scene


def study(
    scene: SceneArgument,
    strategies: Annotated[str | None, typer.Option("--strategies", "-s", metavar="A,B,...",
                          help="Comma-separated; all that suit the scene if not given.")] = None,
    samplers: Annotated[str, typer.Option("--samplers", metavar="A,B,...", help="Each strategy with each of these: "
                                          "independent, sobol.")] = "independent",
    spp: Annotated[int, typer.Option("--spp", min=4, max=MAX_SPP // 4, help="Samples per pixel of each replica.")]
    = 1024,
    replicas: Annotated[int, typer.Option("--replicas", min=2, max=1000, help="Independent runs of each.")] = 8,
    reference_spp: Annotated[int | None, typer.Option("--reference-spp", min=2, max=MAX_SPP,
                             help="Samples per pixel of Mitsuba's image; 4 x spp if not given.")] = None,
    reference: Annotated[Path | None, typer.Option("--reference", help="A ready reference (.exr) instead.")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder to keep the result in: study.json, "
                                                "images, and table.csv, one number a row.")] = None,
    size: SizeOption = None,
    max_depth: DepthOption = None,
    parameters: SetOption = None,
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
    """Measure how each strategy converges to the reference on a scene, and what equal error costs.

    An interrupted study continues where it was. Exit status 1 when a suiting strategy's mean is not judged pass, or
    one of its tiles fails; tiles that are undecided are told with the samples that they would take.

    Example: `harness study mitsuba_scenes/spheres.xml --strategies uniform,cosine,mixture --spp 4096 --replicas 8`
    """
    from harness.studies.study import study as run_study

    names = _names("--strategies", strategies, "uniform,mixture") if strategies is not None else None
    drawn = _names("--samplers", samplers, "independent,sobol")
    if reference and reference_spp:
        raise HarnessError("--reference-spp is for an image yet to be rendered; leave it out, or --reference")
    loaded = open_scene(scene_file(scene, size, parameters, max_depth))
    ready = _open_reference(reference, loaded) if reference else None
    if output:
        from harness.files import require_writable
        from harness.studies.storage import STUDY_FILE, save_study  # brings matplotlib
        from harness.studies.table import TABLE_FILE, records, write_csv

        require_writable(output / STUDY_FILE)
    store = open_store(cache)
    if executor != "serial" and store is None:
        raise HarnessError(f"--executor {executor} hands samples over through the cache; leave out --no-cache")
    with open_executor(executor, jobs, cluster) as workers:
        result = run_study(
            loaded, names, samplers=drawn, spp=spp, replicas=replicas, reference_spp=reference_spp, reference=ready,
            tolerance=tolerance, confidence=confidence, store=store,
            executor=workers if executor != "serial" else None, progress=progress)
    for item in result.strategies:
        if not item.suits:
            log(f"warning: strategy '{item.strategy}': {item.warning}")
        if item.estimate.rejected:
            log(f"warning: strategy '{item.strategy}': {not_finite(item.estimate.rejected)}")
    if output:
        save_study(result, output)
        write_csv(records(result), output / TABLE_FILE)
    if json:
        print_json(_as_json(result))
    else:
        _print(result)
    return 0 if all(item.outcome == "pass" for item in result.strategies if item.suits) else 1


def _names(option: str, given: str, example: str) -> list[str]:
    """'uniform,mixture' as a list."""
    names = [name.strip() for name in given.split(",")]
    if not all(names):
        raise HarnessError(f"{option}: expected names with commas between, such as {example}; found '{given}'")
    return names


def _open_reference(path: Path, scene: Scene) -> Estimate:
    from harness.samples.exr import read_estimate

    estimate, facts = read_estimate(path)
    if estimate.mean.shape[:2] == (scene.height, scene.width):  # else the study refuses it
        warn_of_other_scene(scene.content_hash, facts, path)
    return estimate


def _as_json(result: StudyResult) -> dict[str, Any]:
    return {
        "scene": result.scene, "parameters": dict(result.strategies[0].measured[0].parameters),
        "scene_hash": result.scene_hash, "reference": result.reference_kind,
        "provenance": result.provenance, "notes": result.notes,
        "strategies": [{
            "strategy": item.strategy, "suits": item.suits, "warning": item.warning, "spp": item.spp,
            **item.curves, "slope": item.slope, "outcome": item.outcome, "verdict": item.verdict,
            "tiles": item.tiles, **item.scores, "seconds_per_spp": item.seconds_per_spp,
            "device": item.device,
            "rejected": item.estimate.rejected,
        } for item in result.strategies],
    }


def _print(result: StudyResult) -> None:
    from rich.table import Table

    from harness.metrics import shown_in

    table = Table(box=None, pad_edge=False)
    headings = [metric.heading for metric in shown_in("study")]
    for heading in ("strategy", "mean error", "interval", "verdict", *headings, "slope", "interval", "s/spp", "device"):
        table.add_column(heading, justify="left" if heading in ("strategy", "verdict") else "right")
    for item in result.strategies:
        table.add_row(item.strategy, *_cells(item))
    print_rich(table)
    for item in result.strategies:
        print(f"{item.strategy}: {item.verdict.outcome if item.suits else 'not suited'}: "
              f"{item.verdict.reason if item.suits else item.warning}")
        for tiles in (item.tiles.coarse, item.tiles.fine) if item.suits else ():
            print(f"  tiles of {tiles.tile} px: {tiles.outcome}: {tiles.told}")


def _cells(item: StrategyResult) -> tuple[str, ...]:
    from harness.metrics import shown_in

    verdict, slope = item.verdict, item.slope
    error, low, high = verdict.luminance
    return (
        f"{error:+.3%}", f"{low:+.3%} to {high:+.3%}", verdict.outcome if item.suits else f"({verdict.outcome})",
        *(metric.text(item.score(metric.name)) for metric in shown_in("study")),
        f"{slope.slope:.3f}" if slope else "exact", f"{slope.low:.3f} to {slope.high:.3f}" if slope else "",
        f"{item.seconds_per_spp:.3g}", item.device,
    )
