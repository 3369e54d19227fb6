"""`harness compare`: every metric between two images, and the bias verdict."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from harness.cli.options import (
    MAX_EXPOSURE,
    SCENE_HASH,
    ConfidenceOption,
    ToleranceOption,
    warn_of_other_scene,
)
from harness.cli.output import JsonOption, log, print_json, print_rich
from harness.errors import HarnessError
from harness.stats.channels import CHANNELS

if TYPE_CHECKING:
    from harness.samples.estimate import Estimate
    from harness.stats.bias import MeanErrorVerdict
    from harness.stats.findings import Tiles


def compare(
    test: Annotated[Path, typer.Argument(help="The image under test (.exr).", show_default=False)],
    reference: Annotated[Path, typer.Argument(help="What it should be (.exr).", show_default=False)],
    tolerance: ToleranceOption = 0.002,
    confidence: ConfidenceOption = 0.95,
    exposure: Annotated[float | None, typer.Option(min=-MAX_EXPOSURE, max=MAX_EXPOSURE, help="Stops, for the display "
                                                   "metrics; otherwise the reference file's own, or 0.")] = None,
    json: JsonOption = False,
) -> int:
    """Compare an image with its reference: every metric, and whether the means agree within the tolerance.

    Tiles, larger and smaller, are judged too, with tolerances 6.25 and 25 times that of the mean. Exit status 0 when
    the verdict on the mean is pass and no tile fails, 1 otherwise. Files of other renderers carry no variance: for
    them there are metrics but no verdict, and the status is 0 unless a tested pixel is not finite.

    Example: `harness compare spheres.exr truth.exr --tolerance 0.002`
    """
    import numpy as np

    from harness.policy import fail_level, judge
    from harness.samples.exr import read_estimate

    images = {path: read_estimate(path) for path in (test, reference)}
    (ours, our_facts), (truth, facts) = images[test], images[reference]
    if ours.mean.shape != truth.mean.shape:
        raise HarnessError(f"{test} is {_size(ours)}, {reference} is {_size(truth)}; render both at the same size")
    warn_of_other_scene(our_facts.get(SCENE_HASH), facts, reference)
    for path, (image, _) in images.items():
        if broken := int((~np.isfinite(image.mean).all(axis=-1)).sum()):
            log(f"warning: {path}: pixels that are not finite: {broken}; metrics that see them are not either")
    exposure = _own_exposure(facts) if exposure is None else exposure
    # A file of ours without variance has too few samples, of which the verdict speaks.
    silent = [path for path, (image, its) in images.items()
              if SCENE_HASH not in its and np.isnan(image.image_variance).any()]
    with np.errstate(invalid="ignore"):  # of pixels just warned of
        values = _metrics(ours, truth, exposure)
        verdict, tiles = None, None
        if not silent or not np.isfinite(ours.mean).all():
            verdict = judge(ours, truth, tolerance=tolerance, confidence=confidence, fail_level=fail_level(1))
            tiles = _judge_tiles(ours, truth, tolerance, confidence)
    if json:
        print_json({"test": test, "reference": reference, "exposure": exposure, **values, "verdict": verdict,
                    "tiles": tiles})
    else:
        _print(values, verdict, silent, tolerance, confidence)
        for part in (tiles.coarse, tiles.fine) if tiles else ():
            print(f"tiles of {part.tile} px: {part.outcome}: {part.told}")
    good = verdict is None or tiles is None or (verdict.outcome == "pass" and not tiles.failed)
    return 0 if good else 1


def _judge_tiles(ours: Estimate, truth: Estimate, tolerance: float, confidence: float) -> Tiles:
    from harness.policy import fail_level, tolerances
    from harness.stats.findings import judge_tiles
    from harness.stats.tiles import tile_size
    from harness.work.run import tiles_of

    tile = tile_size(*ours.mean.shape[:2])
    return judge_tiles(tiles_of(ours, tile), tiles_of(truth, tile), tolerances(tolerance),
                       fail_level=fail_level(1), pass_level=1 - confidence)


def _own_exposure(facts: Mapping[str, object]) -> float:
    """The exposure that a file of ours carries; other renderers may mean something else by the name."""
    exposure = facts.get("exposure")
    return float(exposure) if SCENE_HASH in facts and isinstance(exposure, int | float) else 0.0


def _metrics(ours: Estimate, truth: Estimate, exposure: float) -> dict[str, float]:
    from harness import metrics

    return metrics.measure(ours.mean, truth, exposure)


def _print(values: dict[str, Any], verdict: MeanErrorVerdict | None, silent: list[Path], tolerance: float,
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
    print(f"verdict: {verdict.outcome}: {verdict.reason}" if verdict is not None else
          f"no verdict: {' and '.join(map(str, silent))} without variance; `harness render` and `harness reference` "
          "write it")


def _size(estimate: Estimate) -> str:
    height, width = estimate.mean.shape[:2]
    return f"{width} x {height}"
