"""A study as a tidy table: one number a row, and beside it all that it depends on."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from harness import metrics
from harness.files import write_atomically
from harness.results import REJECTED, SECONDS, Record, StrategyResult, StudyResult
from harness.stats.channels import CHANNELS

TABLE_FILE = "table.csv"


def measured(scene: str, parameters: tuple[tuple[str, str], ...], estimator: str, *, samples: int, spp: np.ndarray,
             curves: Mapping[str, np.ndarray], scores: Mapping[str, float], seconds_per_spp: float, rejected: int,
             device: str) -> tuple[Record, ...]:
    """The rows of what was measured of one estimator: curves (R, P) at prefixes of `spp` (P,) samples per pixel, then
    of all replicas together, `samples` per pixel, the other metrics, the cost and the samples that were rejected."""
    replicas = len(next(iter(curves.values())))
    every = Record(scene, parameters, estimator, None, samples, "", "", math.nan, None, None, replicas, device)
    channels = {metric.name: metric.channel for metric in metrics.METRICS}
    points = (replace(every, replica=replica, samples=int(at), quantity=name, channel=channels[name],
                      value=float(value), n=1)
              for name, all_curves in curves.items() for replica, curve in enumerate(all_curves)
              for at, value in zip(spp, curve, strict=True))
    ends = (replace(every, quantity=name, channel=channels[name], value=float(value))
            for name, value in scores.items())
    return (*points, *ends, replace(every, quantity=SECONDS, value=float(seconds_per_spp)),
            replace(every, quantity=REJECTED, value=float(rejected)))


def records(result: StudyResult) -> Iterator[Record]:
    """The whole table of a study: for each strategy what was measured, then what its verdict and its slope say."""
    for item in result.strategies:
        yield from item.measured
        yield from _judged(item)


def write_csv(rows: Iterable[Record], path: Path) -> None:
    """Write records as CSV (RFC 4180 but for lines that end in a newline alone) under a line of their fields' names.

    What does not apply is an empty field; parameters stand as `name=value`, with spaces between; numbers have all their
    digits, and are `nan` or `inf` where they are not finite. StoreError when the file cannot be written.
    """
    with write_atomically(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        names = [field.name for field in fields(Record)]
        writer.writerow(names)
        for row in rows:
            parameters = " ".join(f"{name}={value}" for name, value in row.parameters)
            writer.writerow(parameters if name == "parameters" else getattr(row, name) for name in names)


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
