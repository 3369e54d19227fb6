"""What a gate leaves behind: images, maps, the curve, the numbers, and the command that runs it again."""

from __future__ import annotations

import json
import math
import os
import shlex
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import FuncFormatter, NullLocator, PercentFormatter

from harness.diagnosis.text import lines
from harness.files import write_atomically
from harness.gates.left import (
    ALL_PICTURES,
    AUTOPSY,
    CURVE,
    DIFFERENCE,
    IMAGES,
    LADDER,
    RESULT_FILE,
    WRONG_DEPTH,
    Z_MAP,
)
from harness.gates.model import Gate, GateResult, Ladder
from harness.gates.records import as_json
from harness.report.figures.pictures import DIFFERENCE_MAP, difference_map, robust_limit, tile_pixels
from harness.report.figures.style import TOLERANCE_COLOUR, strategy_style
from harness.report.figures.svg import blank, png, svg
from harness.results import AgreementRecord, GateNumbers, GateRecord, LookRecord, PartRecord, PointRecord, RungRecord
from harness.samples.exr import write_estimate
from harness.samples.images import write_png
from harness.stats.agreement import AgreementVerdict
from harness.stats.bias import Outcome
from harness.stats.findings import largest_deviates

# The difference map's range is at least that of visible errors, the z-map's that of chance.
LEAST_DIFFERENCE = 0.02
LEAST_Z = 5.0
_MAP_CM, _CURVE_CM, _LADDER_CM = (13.0, 9.5), (17.0, 7.0), (13.0, 7.0)


def save_result(result: GateResult, folder: Path, *, pictures: bool = True) -> None:
    """Write result.json into `folder` and, if asked, images, maps and curve; what an earlier run left is removed.

    StoreError when a file cannot be written.
    """
    clear(folder)
    if pictures:
        facts = {"gate": result.gate.name, "strategy": result.gate.strategy, "exposure": result.exposure}
        for name, estimate in (("test", result.test), ("reference", result.reference)):
            write_estimate(folder / f"{name}.exr", estimate, facts)
            write_png(folder / f"{name}.png", estimate.mean, result.exposure)
        # Letters as shapes: the file is looked at alone, where nobody brings the fonts.
        curve = svg(lambda: _curve(result), result.gate.name, letters_as_shapes=True)
        figures = {Z_MAP: png(lambda: _z_map(result)), DIFFERENCE: png(lambda: _difference(result)), CURVE: curve}
        if ladder := result.ladder:
            if ladder.rungs:
                figures[LADDER] = svg(lambda: _ladder(result, ladder), f"{result.gate.name} ladder",
                                      letters_as_shapes=True)
            if (rung := ladder.wrong) and (wrong := rung.result):
                figures[WRONG_DEPTH] = png(lambda: _difference(wrong, f" at depth {rung.depth}"))
        for name, content in figures.items():
            with write_atomically(folder / name) as partial:
                partial.write_bytes(content)
    if result.autopsy:
        with write_atomically(folder / AUTOPSY) as partial:
            partial.write_text(_autopsy(result) + "\n", encoding="utf-8")
    with write_atomically(folder / RESULT_FILE) as partial:
        partial.write_text(json.dumps(as_json(record(result)), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def clear(folder: Path) -> None:
    """Remove what an earlier run of the gate left in its folder."""
    for name in (*IMAGES, *ALL_PICTURES, AUTOPSY, RESULT_FILE):
        with suppress(OSError):
            (folder / name).unlink()


def command(gate: Gate) -> str:
    """The command that runs the gate again."""
    file = gate.origin.rpartition(":")[0]
    with suppress(ValueError):  # another drive
        if not (relative := os.path.relpath(file)).startswith(".."):
            file = relative
    return f"harness gate {shlex.quote(file)} --only {gate.name}"


def error_record(gate: Gate, error: Exception) -> GateRecord:
    """The record of a gate that could not be run."""
    return _record(gate, "error", str(error))


def record(result: GateResult) -> GateRecord:
    """What the result says, less images and maps."""
    gate, verdict = result.gate, result.verdict
    numbers = GateNumbers(
        error=_numbers(verdict.mean.error[0, 0]), low=_numbers(verdict.mean.low[0, 0]),
        high=_numbers(verdict.mean.high[0, 0]), confidence=round(1 - gate.pass_level, 12),
        tests={name: PartRecord(
            part.outcome, part.reason, part.tolerance, part.tile, part.p, _number(np.max(np.abs(part.error))),
            _number(result.smallest_detectable[name]),
        ) for name, part in (("mean", verdict.mean), ("coarse", verdict.coarse), ("fine", verdict.fine))},
        looks=tuple(LookRecord(look.samples, look.reference_samples, look.verdict.outcome, look.verdict.reason,
                               *_numbers(look.verdict.luminance)) for look in result.looks),
        curve=tuple(PointRecord(point.samples, *_numbers((point.error, point.low, point.high, point.tile_rmse)))
                    for point in result.curve),
        samples=result.test.samples, budget=gate.spp * gate.replicas, not_finite=result.test.rejected,
        fail_level=gate.fail_level, seconds=round(result.seconds, 3), agreement=_agreement(result.agreement))
    told = replace(_record(gate, result.outcome, result.reason), numbers=numbers, autopsy=_autopsy(result))
    if result.ladder is None:
        return told
    rungs = tuple(RungRecord(rung.depth, rung.outcome, rung.reason, rung.samples,
                             *_numbers((rung.error, rung.low, rung.high))) for rung in result.ladder.rungs)
    return replace(told, wrong_from=_wrong_from(result.ladder), ladder=rungs)


def _autopsy(result: GateResult) -> str:
    return "\n".join(line.rstrip() for line in lines(result.autopsy)) if result.autopsy else ""


def _wrong_from(ladder: Ladder) -> int | None:
    if ladder.wrong:
        return ladder.wrong.depth
    known = ladder.rungs and ladder.rungs[-1].depth != ladder.top
    return ladder.top if known else None


def _record(gate: Gate, outcome: Outcome | Literal["error"], reason: str) -> GateRecord:
    return GateRecord(gate.name, outcome, reason, why=gate.reason, scene=gate.scene.name, strategy=gate.strategy,
                      origin=gate.origin, command=command(gate))


def _agreement(found: AgreementVerdict | None) -> AgreementRecord | None:
    if found is None:
        return None
    return AgreementRecord(found.outcome, found.reason, found.tolerance, found.threshold, found.share, found.low,
                           found.high, found.samples)


def _numbers(values: Iterable[float]) -> tuple[float | None, ...]:
    return tuple(_number(value) for value in values)


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _z_map(result: GateResult) -> Figure:
    """Errors of the smaller tiles over their standard errors, of the channel in which each is largest."""
    fine = result.verdict.fine
    z = largest_deviates(fine.z)
    limit = max(LEAST_Z, float(np.nanmax(np.abs(z), initial=0.0)))
    height, width = result.test.mean.shape[:2]
    figure = _map(tile_pixels(z, fine.tile, height, width), limit,
                  f"{result.gate.name}: error of each tile over its standard error",
                  f"z; chance stays within ±{fine.critical:.1f}")
    row, column = fine.worst
    corner = (column * fine.tile - 0.5, row * fine.tile - 0.5)
    figure.axes[0].add_patch(Rectangle(corner, fine.tile, fine.tile, fill=False, edgecolor="black", linewidth=1.2))
    return figure


def _difference(result: GateResult, where: str = "") -> Figure:
    """The signed relative difference of luminance of each pixel."""
    difference = difference_map(result.test.mean, result.reference.mean)
    figure = _map(difference, robust_limit([difference], LEAST_DIFFERENCE),
                  f"{result.gate.name}: relative difference of luminance{where}", "(test − reference) / reference")
    figure.axes[1].yaxis.set_major_formatter(PercentFormatter(1.0, decimals=None))
    return figure


def _map(values: np.ndarray, limit: float, title: str, label: str) -> Figure:
    figure = blank(*_MAP_CM, layout="constrained")
    axes = figure.subplots()
    axes.set_facecolor("#a0a0a0")  # what is not finite
    shown = axes.imshow(values, cmap=DIFFERENCE_MAP, vmin=-limit, vmax=limit, interpolation="nearest")
    axes.set_title(title, loc="left")
    clipped = np.nanmax(np.abs(values), initial=0.0) > limit
    figure.colorbar(shown, ax=axes, label=label, extend="both" if clipped else "neither", shrink=0.85)
    return figure


def _ladder(result: GateResult, ladder: Ladder) -> Figure:
    """Mean error with its interval at each depth, the scene's own last, inside the tolerance's band."""
    figure = blank(*_LADDER_CM, layout="constrained")
    axes = figure.subplots()
    style = strategy_style(result.gate.strategy)
    tolerance = result.gate.tolerance.mean
    axes.axhspan(-tolerance, tolerance, color=TOLERANCE_COLOUR, linewidth=0, zorder=0)
    axes.axhline(0, color="#888888", linewidth=0.5)
    found = [(str(rung.depth), rung.outcome, rung.error, rung.low, rung.high) for rung in ladder.rungs]
    found.append((str(ladder.top or "unbounded"), result.outcome, *result.verdict.luminance))
    for place, (_, outcome, error, low, high) in enumerate(found):
        if math.isfinite(low) and math.isfinite(high):
            axes.plot([place, place], [low, high], color=style.colour, alpha=0.5)
        if math.isfinite(error):
            axes.plot(place, error, color=style.colour, marker=style.marker)
        axes.annotate(outcome, (place, 1.0), xycoords=("data", "axes fraction"), ha="center", va="bottom", size="small")
    axes.set_xticks(range(len(found)), [depth for depth, *_ in found])
    axes.set_xlim(-0.5, len(found) - 0.5)
    axes.set_xlabel("vertices of a path at most")
    axes.set_title("Mean error of luminance by depth", loc="left", pad=14)
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=None))
    return figure


def _curve(result: GateResult) -> Figure:
    """Mean error with its interval inside the tolerance's band, and the tiles' RMSE, against samples per pixel."""
    figure = blank(*_CURVE_CM, layout="constrained")
    left, right = figure.subplots(1, 2)
    style = strategy_style(result.gate.strategy)
    samples = np.array([point.samples for point in result.curve])
    tolerance = result.gate.tolerance.mean
    left.axhspan(-tolerance, tolerance, color=TOLERANCE_COLOUR, linewidth=0, zorder=0)
    left.axhline(0, color="#888888", linewidth=0.5)
    values = np.array([(point.error, point.low, point.high) for point in result.curve]).T
    left.fill_between(samples, values[1], values[2], color=style.colour, alpha=0.18, linewidth=0)
    left.plot(samples, values[0], color=style.colour, marker=style.marker)
    for look in result.looks:
        left.axvline(look.samples, color="#888888", linewidth=0.5, linestyle=(0, (2, 2)))
    left.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=None))
    left.set_title("Mean error of luminance; dashed: looks", loc="left")
    rmse = np.array([point.tile_rmse for point in result.curve])
    positive = rmse > 0
    if positive.any():
        right.plot(samples[positive], rmse[positive], color=style.colour, marker=style.marker)
        guide = rmse[positive][0] * np.sqrt(samples[positive][0] / samples)
        right.plot(samples, guide, color="#888888", linewidth=0.6, linestyle=(0, (2, 2)))
        right.set_yscale("log")
        right.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=None))
        right.yaxis.set_minor_formatter(PercentFormatter(1.0, decimals=None))
    right.set_title("RMSE of the smaller tiles; dashed: slope −1/2", loc="left")
    for axes in (left, right):
        axes.set_xscale("log", base=2)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:,.0f}".replace(",", " ")))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xlabel("samples per pixel")
    return figure
