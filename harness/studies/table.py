"""A study as a tidy table: one number a row, and beside it all that it depends on."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from harness import metrics
from harness.files import write_atomically
from harness.results import REJECTED, SECONDS, Record, StrategyResult, StudyResult
from harness.stats.channels import CHANNELS
from harness.studies.costs import Costs, costs_of
from harness.studies.parameters import is_numeric

TABLE_FILE = "table.csv"
PARQUET_FILE = "table.parquet"
NAMES = tuple(field.name for field in fields(Record))
# What a column holds; a parameter's, what its values are.
KINDS: dict[str, type] = {"scene": str, "parameters": str, "estimator": str, "replica": int, "samples": int,
                          "quantity": str, "channel": str, "value": float, "low": float, "high": float, "n": int,
                          "device": str}


def measured(scene: str, parameters: tuple[tuple[str, str], ...], estimator: str, *, samples: int, spp: np.ndarray,
             curves: Mapping[str, np.ndarray], scores: Mapping[str, float], seconds_per_spp: float, rejected: int,
             device: str, replica_seconds: Sequence[float] = ()) -> tuple[Record, ...]:
    """The rows of what was measured of one estimator: curves (R, P) at prefixes of `spp` (P,) samples per pixel and
    what a sample of each replica took, then of all replicas together, `samples` per pixel, the other metrics, the cost
    and the samples that were rejected."""
    replicas = len(next(iter(curves.values())))
    every = Record(scene, parameters, estimator, None, samples, "", "", math.nan, None, None, replicas, device)
    channels = {metric.name: metric.channel for metric in metrics.METRICS}
    points = (replace(every, replica=replica, samples=int(at), quantity=name, channel=channels[name],
                      value=float(value), n=1)
              for name, all_curves in curves.items() for replica, curve in enumerate(all_curves)
              for at, value in zip(spp, curve, strict=True))
    ends = (replace(every, quantity=name, channel=channels[name], value=float(value))
            for name, value in scores.items())
    alone = (replace(every, replica=replica, samples=int(spp[-1]), quantity=SECONDS, value=float(seconds), n=1)
             for replica, seconds in enumerate(replica_seconds))
    return (*points, *alone, *ends, replace(every, quantity=SECONDS, value=float(seconds_per_spp)),
            replace(every, quantity=REJECTED, value=float(rejected)))


def records(result: StudyResult) -> Iterator[Record]:
    """The whole table of a study: for each strategy what was measured, then what its verdict, its slope and its costs
    say."""
    costs = costs_of(result)
    for item, cost in zip(result.strategies, costs.lines, strict=True):
        yield from item.measured
        yield from _judged(item)
        yield from _costs(item, cost, costs.rmse)


def write_csv(rows: Iterable[Record], path: Path) -> None:
    """Write records as CSV (RFC 4180 but for lines that end in a newline alone) under a line of their fields' names.

    What does not apply is an empty field; parameters stand as `name=value`, with spaces between, and each once more in
    a column of its own; numbers have all their digits, and are `nan` or `inf` where they are not finite. StoreError
    when the file cannot be written.
    """
    table = columns(rows)
    with write_atomically(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(table)
        writer.writerows(zip(*table.values(), strict=True))


def write_parquet(rows: Iterable[Record], path: Path) -> None:
    """The same table as Parquet (format 1.0, Zstandard): text, 64-bit integers and doubles, null where nothing applies.

    A parameter's own column holds doubles where all its values are numbers. StoreError when the file cannot be written.
    """
    from arro3.core import Array, DataType, Table
    from arro3.io import write_parquet as write

    kinds = {int: DataType.int64(), float: DataType.float64(), str: DataType.utf8()}
    table = columns(rows)
    arrays: dict[str, Any] = {}
    for name, values in table.items():
        kind = KINDS.get(name, str)
        if name not in KINDS and is_numeric([value for value in values if value is not None]):
            kind, values = float, [None if value is None else float(value) for value in values]
        arrays[name] = Array(values, type=kinds[kind])
    with write_atomically(path) as partial:
        write(Table.from_pydict(arrays), str(partial), compression="zstd(3)")


def columns(rows: Iterable[Record]) -> dict[str, list[Any]]:
    """A table's columns by name: the fields of a record, and one for each parameter that some record has, None where
    another has it not. A parameter that is called like a field has `parameter_` before its name."""
    held = list(rows)
    table: dict[str, list[Any]] = {name: [getattr(row, name) for row in held] for name in NAMES}
    table["parameters"] = [" ".join(f"{name}={value}" for name, value in row.parameters) for row in held]
    given = [dict(row.parameters) for row in held]
    for name in dict.fromkeys(name for each in given for name in each):
        table[name if name not in NAMES else f"parameter_{name}"] = [each.get(name) for each in given]
    return table


def _costs(item: StrategyResult, costs: Costs, rmse: float | None) -> Iterator[Record]:
    """What an error costs. `samples`: those that the curve has, beyond which the others are extrapolated."""
    every = replace(item.measured[-1], samples=int(item.spp[-1]), low=None, high=None)
    if rmse is not None:
        yield replace(every, quantity="rmse_to_reach", value=rmse)
    for quantity, found in (("samples_to_rmse", costs.samples), ("seconds_to_rmse", costs.seconds),
                            ("time_to_unit_variance", costs.ttuv)):
        if found is not None:
            yield replace(every, quantity=quantity, value=found.value, low=found.low, high=found.high)


def _judged(item: StrategyResult) -> Iterator[Record]:
    """Mean error and smallest detectable bias of each channel, and the slope."""
    verdict, slope = item.verdict, item.slope
    every = replace(item.measured[-1], low=None, high=None)
    for index, channel in enumerate(CHANNELS):
        yield replace(every, quantity="mean_error", channel=channel, value=float(verdict.error[index]),
                      low=float(verdict.low[index]), high=float(verdict.high[index]))
        yield replace(every, quantity="smallest_detectable", channel=channel,
                      value=float(verdict.smallest_detectable[index]))
    if slope is not None:
        yield replace(every, samples=int(item.spp[-1]), quantity="slope", value=slope.slope, low=slope.low,
                      high=slope.high, n=slope.replicas)
