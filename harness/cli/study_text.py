"""What `harness study` says: a study, or a product of them, as tables on a terminal and as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from rich.table import Table

from harness.cli.output import print_rich
from harness.metrics import shown_in
from harness.results import StrategyResult, StudyResult
from harness.stats.convergence import Reach
from harness.stats.efficiency import Factor
from harness.studies.costs import costs_of
from harness.studies.product import StudyProduct

_WORDS = ("strategy", "scene", "verdict")


def as_json(result: StudyResult) -> dict[str, Any]:
    """A study as one object."""
    costs = costs_of(result)
    return {
        "scene": result.scene, "parameters": dict(result.cell[1]),
        "scene_hash": result.scene_hash, "reference": result.reference_kind,
        "provenance": result.provenance, "notes": result.notes,
        "rmse_to_reach": costs.rmse,
        "strategies": [{
            "strategy": item.strategy, "suits": item.suits, "warning": item.warning, "spp": item.spp,
            **item.curves, "slope": item.slope, "outcome": item.outcome, "verdict": item.verdict,
            "tiles": item.tiles, **item.scores, "seconds_per_spp": item.seconds_per_spp,
            "device": item.device,
            "rejected": item.estimate.rejected,
            "samples_to_rmse": cost.samples, "seconds_to_rmse": cost.seconds, "time_to_unit_variance": cost.ttuv,
        } for item, cost in zip(result.strategies, costs.lines, strict=True)],
    }


def print_study(result: StudyResult) -> None:
    """One study: errors, costs, and what verdicts say."""
    table = _table("strategy", *_headings())
    for item in result.strategies:
        table.add_row(item.strategy, *_cells(item))
    print_rich(table)
    for item in result.strategies:
        print(f"{item.strategy}: {item.verdict.outcome if item.suits else 'not suited'}: "
              f"{item.verdict.reason if item.suits else item.warning}")
        for tiles in (item.tiles.coarse, item.tiles.fine) if item.suits else ():
            print(f"  tiles of {tiles.tile} px: {tiles.outcome}: {tiles.told}")
    _print_costs([result], ())


def print_product(product: StudyProduct) -> None:
    """All studies in one table, the verdicts that are not pass, and costs."""
    names = tuple(name for name, _ in product.axes)
    table = _table("scene", *names, "strategy", *_headings())
    for each in product.studies:
        for item in each.strategies:
            table.add_row(*_place(each, names), item.strategy, *_cells(item))
    print_rich(table)
    for each in product.studies:
        for item in each.strategies:
            name = f"{each.scene} {item.strategy}"
            if not item.suits:
                print(f"{name}: not suited: {item.warning}")
                continue
            if item.verdict.outcome != "pass":
                print(f"{name}: {item.verdict.outcome}: {item.verdict.reason}")
            for tiles in (item.tiles.coarse, item.tiles.fine):
                if tiles.outcome == "fail":
                    print(f"{name}: tiles of {tiles.tile} px: fail: {tiles.told}")
    _print_costs(product.studies, names)
    lines = [item for each in product.studies for item in each.strategies if item.suits]
    print(f"{sum(item.outcome == 'pass' for item in lines)} of {len(lines)} lines pass, in {len(product.studies)} "
          "studies")


def _headings() -> tuple[str, ...]:
    headings = (metric.heading for metric in shown_in("study"))
    return "mean error", "interval", "verdict", *headings, "slope", "interval", "s/spp", "device"


def _table(*headings: str) -> Table:
    table = Table(box=None, pad_edge=False)
    for heading in headings:
        table.add_column(heading, justify="left" if heading in _WORDS else "right")
    return table


def _place(each: StudyResult, names: Sequence[str]) -> tuple[str, ...]:
    scene, parameters = each.cell
    return scene, *(dict(parameters).get(name, "") for name in names)


def _cells(item: StrategyResult) -> tuple[str, ...]:
    verdict, slope = item.verdict, item.slope
    error, low, high = verdict.luminance
    without = "exact" if len(item.spp) > 2 else "–"
    return (
        f"{error:+.3%}", f"{low:+.3%} to {high:+.3%}", verdict.outcome if item.suits else f"({verdict.outcome})",
        *(metric.text(item.score(metric.name)) for metric in shown_in("study")),
        f"{slope.slope:.3f}" if slope else without, f"{slope.low:.3f} to {slope.high:.3f}" if slope else "",
        f"{item.seconds_per_spp:.3g}" if math.isfinite(item.seconds_per_spp) else "–", item.device,
    )


def _print_costs(studies: Sequence[StudyResult], names: Sequence[str]) -> None:
    """Samples and seconds until an error is reached, and time to unit variance, with their intervals."""
    table = _table(*(("scene", *names) if len(studies) > 1 else ()), "strategy", "RMSE", "samples to it", "interval",
                   "seconds to it", "interval", "variance x time", "interval")
    extrapolated = False
    for each in studies:
        costs = costs_of(each)
        if costs.rmse is None:
            continue
        for cost in costs.lines:
            if cost.samples is None:
                continue
            extrapolated |= bool(cost.samples.extrapolated)
            table.add_row(*(_place(each, names) if len(studies) > 1 else ()), cost.estimator, f"{costs.rmse:.3g}",
                          *_reach(cost.samples, cost.samples), *_reach(cost.seconds, cost.samples), *_factor(cost.ttuv))
    if table.row_count:
        print()
        print_rich(table)
        if extrapolated:
            print("* not measured: the curve does not come to this error, and its fitted slope is taken to go on")


def _reach(found: Reach | None, samples: Reach) -> tuple[str, str]:
    if found is None or math.isnan(found.value):
        return "–", ""
    if math.isinf(found.value):
        return "never", "the error does not fall"
    return f"{found.value:.3g}{'*' if samples.extrapolated else ' '}", f"{found.low:.3g} to {found.high:.3g}"


def _factor(found: Factor | None) -> tuple[str, str]:
    return ("–", "") if found is None else (f"{found.value:.3g}", f"{found.low:.3g} to {found.high:.3g}")
