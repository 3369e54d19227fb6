"""`harness compare`: every metric between anybody's renders and a reference, and the bias verdict."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from harness.cli.options import (
    MAX_EXPOSURE,
    MAX_SPP,
    SAMPLER,
    SCENE_HASH,
    CacheOption,
    ConfidenceOption,
    DepthOption,
    DeviceOption,
    ProfileTimeOption,
    SizeOption,
    ToleranceOption,
    warn_of_other_scene,
)
from harness.cli.output import JsonOption, print_json, print_rich
from harness.errors import HarnessError
from harness.stats.channels import CHANNELS

if TYPE_CHECKING:
    from harness.cli.sides import Side
    from harness.estimators.command import Command
    from harness.samples.estimate import Estimate
    from harness.scene import SceneFile
    from harness.stats.bias import MeanErrorVerdict
    from harness.stats.findings import Tiles
    from harness.stats.tiles import TileSamples

# More runs of a program than verdicts gain by (gates.model.MAX_REPLICAS).
MAX_RUNS = 256


def compare(
    files: Annotated[list[str] | None, typer.Argument(
        metavar="TEST REFERENCE", show_default=False,
        help="The renders under test, and what they should be: each a file, a folder or a quoted pattern "
             "(EXR, PFM, Radiance HDR, PNG, JPEG). With --command the reference alone, or nothing.")] = None,
    command: Annotated[str | None, typer.Option("--command", metavar="TEMPLATE", help=(
        'Run a program in place of TEST: "myrt {scene} --spp {spp} --seed {seed} -o {out}"; {width}, '
        "{height} and {max_depth} may stand in it too."))] = None,
    scene: Annotated[Path | None, typer.Option("--scene", help="The scene file for --command.")] = None,
    spp: Annotated[int, typer.Option("--spp", min=1, max=MAX_SPP, help="Samples per pixel of a run of --command.")]
    = 64,
    replicas: Annotated[int, typer.Option("--replicas", min=1, max=MAX_RUNS, help="Runs of --command, each with a seed "
                                                                                  "of its own.")] = 16,
    timeout: Annotated[float, typer.Option("--timeout", min=0.1, help="Seconds that a run of --command may take.")]
    = 600.0,
    parameters: Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help=(
        "A parameter (<default>) of the scene; may be given several times."))] = None,
    size: SizeOption = None,
    max_depth: DepthOption = None,
    cache: CacheOption = True,
    device: DeviceOption = None,
    tolerance: ToleranceOption = 0.002,
    confidence: ConfidenceOption = 0.95,
    exposure: Annotated[float | None, typer.Option(min=-MAX_EXPOSURE, max=MAX_EXPOSURE, help="Stops, for the display "
                                                   "metrics; otherwise the reference file's own, or 0.")] = None,
    profile_time: ProfileTimeOption = False,
    json: JsonOption = False,
) -> int:
    """Compare anybody's renders with a reference: every metric, and whether the means agree within the tolerance.

    Several files of a side ('mine_*.exr', quoted) are independent runs, whose scatter tells the noise. Tiles, larger
    and smaller, are judged too, with tolerances 6.25 and 25 times that of the mean. Exit status 0 when the verdict on
    the mean is pass and no tile fails, 1 otherwise. A single file of another renderer carries no variance: for it there
    are metrics but no verdict, and the status is 0 unless a tested pixel is not finite.

    With --command a program renders the scene, and Mitsuba is the reference if none is given.

    Example: `harness compare spheres.exr truth.exr --tolerance 0.002`
    """
    import numpy as np

    from harness.cli.sides import buys, files_side, require_comparable, smallest_detectable
    from harness.estimators.command import Command
    from harness.policy import fail_level, judge

    words = files or []
    if command is None:
        _require_two(words)
        if scene is not None or parameters or size or max_depth:
            raise HarnessError("--scene, --set, --size and --max-depth belong to --command; files are compared as they "
                               "are")
        test, reference = files_side(words[0]), files_side(words[1])
    else:
        file = _scene_of(scene, parameters or [], size, max_depth)
        test, reference = _command_sides(Command(command, timeout), file, words, spp, replicas, cache)
    require_comparable(test, reference)
    ours, truth, facts = test.estimate, reference.estimate, reference.facts
    warn_of_other_scene(test.facts.get(SCENE_HASH), facts, Path(reference.name))
    exposure = _own_exposure(facts) if exposure is None else exposure
    # A file of ours without variance has too few samples, of which the verdict speaks; or its sampler spreads them
    # evenly, of which only several files tell the noise, as of somebody else's.
    silent = [side for side in (test, reference)
              if (SCENE_HASH not in side.facts or SAMPLER in side.facts) and side.runs < 2 and not side.knows_variance]
    with np.errstate(invalid="ignore"):  # of pixels just warned of
        values = _metrics(ours, truth, exposure)
        verdict, tiles, detectable = None, None, None
        if not silent or not np.isfinite(ours.mean).all():
            verdict = judge(ours, truth, tolerance=tolerance, confidence=confidence, fail_level=fail_level(1))
            tiles = _judge_tiles(test.tiles, reference.tiles, tolerance, confidence)
            detectable = smallest_detectable(tolerance, verdict, tiles)
        more = "; ".join(buys(test, reference, side) for side in silent)
    if json:
        print_json({"test": test.name, "reference": reference.name, "exposure": exposure, **values, "verdict": verdict,
                    "tiles": tiles, "smallest_detectable": detectable,
                    "sides": {"test": test.told, "reference": reference.told}})
    else:
        _print(values, verdict, more, tolerance, confidence)
        for part in (tiles.coarse, tiles.fine) if tiles else ():
            print(f"tiles of {part.tile} px: {part.outcome}: {part.told}")
        if tiles and detectable:
            print(f"smallest bias sure to fail: {_bias(detectable['mean'])} of the mean, "
                  f"{_bias(detectable['coarse'])} in any tile of {tiles.coarse.tile} px, "
                  f"{_bias(detectable['fine'])} in any of {tiles.fine.tile} px; from {_drawn(test)} against "
                  f"{_drawn(reference)}")
    good = verdict is None or tiles is None or (verdict.outcome == "pass" and not tiles.failed)
    return 0 if good else 1


def _require_two(words: list[str]) -> None:
    """Two words, neither fewer nor what a shell makes of an unquoted pattern."""
    if not words:
        raise HarnessError("Missing argument 'test'; see `harness compare --help`")
    if len(words) == 1:
        raise HarnessError("Missing argument 'reference'; see `harness compare --help`")
    if len(words) > 2:
        raise HarnessError(f"two arguments are compared, found {len(words)}; quote patterns, so that the shell leaves "
                           "them alone: harness compare 'mine_*.exr' 'truth_*.exr'")


def _scene_of(scene: Path | None, parameters: list[str], size: str | None, max_depth: int | None) -> SceneFile:
    """What a command renders."""
    from harness.cli.options import scene_file

    if scene is None:
        raise HarnessError("--command needs the scene that it renders: --scene SCENE.xml")
    if not scene.is_file():
        raise HarnessError(f"{scene}: no such scene file; give the path of a Mitsuba 3 .xml scene")
    return scene_file(scene, size, parameters, max_depth)


def _command_sides(program: Command, file: SceneFile, words: list[str], spp: int, replicas: int,
                   cache: bool) -> tuple[Side, Side]:
    from harness.cli.options import open_store
    from harness.cli.sides import REFERENCE_FACTOR, files_side, mitsuba_side, runs_side

    if len(words) > 1:
        raise HarnessError(f"with --command there is one argument at the most, the reference, found {len(words)}; "
                           "quote a pattern, so that the shell leaves it alone")
    if words:
        reference = files_side(words[0])
        return runs_side(program, file, replicas, spp), reference
    # The program first: it is the likelier to fail, and Mitsuba takes its time.
    test = runs_side(program, file, replicas, spp)
    return test, mitsuba_side(file, REFERENCE_FACTOR * spp * replicas, open_store(cache))


def _bias(fraction: float) -> str:
    from harness.stats.bias import percent

    return percent(fraction) if fraction < float("inf") else "no bias"


def _drawn(side: Side) -> str:
    return f"{side.runs} runs" if side.runs > 1 else "one image"


def _judge_tiles(ours: TileSamples, truth: TileSamples, tolerance: float, confidence: float) -> Tiles:
    from harness.policy import fail_level, tolerances
    from harness.stats.findings import judge_tiles

    return judge_tiles(ours, truth, tolerances(tolerance), fail_level=fail_level(1), pass_level=1 - confidence)


def _own_exposure(facts: Mapping[str, object]) -> float:
    """The exposure that a file of ours carries; other renderers may mean something else by the name."""
    exposure = facts.get("exposure")
    return float(exposure) if SCENE_HASH in facts and isinstance(exposure, int | float) else 0.0


def _metrics(ours: Estimate, truth: Estimate, exposure: float) -> dict[str, float]:
    from harness import metrics

    return metrics.measure(ours.mean, truth, exposure)


def _print(values: dict[str, Any], verdict: MeanErrorVerdict | None, more: str, tolerance: float,
           confidence: float) -> None:
    from rich.table import Table

    from harness.metrics import shown_in

    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column("metric")
    table.add_column("value", justify="right")
    table.add_column("meaning", style="dim")
    for metric in shown_in("compare"):
        table.add_row(metric.name, f"{values[metric.name]:.5g}", metric.sentence)
    if verdict is not None:
        for channel, error, low, high in zip(CHANNELS, verdict.error, verdict.low, verdict.high, strict=True):
            table.add_row(f"mean error, {channel}", f"{error:+.4%}",
                          f"{confidence:.0%} interval {low:+.4%} to {high:+.4%}, tolerance ±{tolerance:.2%}")
    print_rich(table)
    print(f"verdict: {verdict.outcome}: {verdict.reason}" if verdict is not None else f"no verdict: {more}")
