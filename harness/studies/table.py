"""A study as a tidy table: one number a row, and beside it all that it depends on."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path

from harness import metrics
from harness.files import write_atomically
from harness.results import StrategyResult, StudyResult
from harness.stats.channels import CHANNELS

TABLE_FILE = "table.csv"


@dataclass(frozen=True)
class Record:
    """One number of a study.

    `parameters`: of the scene, as (name, value). `replica`: None where the number is of all replicas together.
    `samples`: per pixel, all that went into it. `quantity`: a metric's name (see `harness.metrics`), or 'slope',
    'smallest_detectable', 'seconds_per_spp', 'rejected' (samples of the whole image). `channel`: empty where it is
    of all. `low`, `high`: the interval, at the confidence of the study's verdicts; None where there is none. `n`: how
    many independent replicas it stands on. `device`: what drew the samples.
    """

    scene: str
    parameters: tuple[tuple[str, str], ...]
    estimator: str
    replica: int | None
    samples: int
    quantity: str
    channel: str
    value: float
    low: float | None
    high: float | None
    n: int
    device: str


def records(result: StudyResult) -> Iterator[Record]:
    """Every number of a study: for each strategy the points of its curves, then what all replicas say together."""
    for item in result.strategies:
        every = Record(result.scene, (), item.strategy, None, item.estimate.samples, "", "", math.nan, None, None,
                       len(item.curves["rmse"]), item.device)
        yield from _curves(every, item)
        yield from _merged(every, item)


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


def _curves(every: Record, item: StrategyResult) -> Iterator[Record]:
    """Each metric of each replica's prefixes."""
    for metric in metrics.METRICS:
        for replica, curve in enumerate(item.curves.get(metric.name, ())):
            for samples, value in zip(item.spp, curve, strict=True):
                yield replace(every, replica=replica, samples=int(samples), quantity=metric.name,
                              channel=metric.channel, value=float(value), n=1)


def _merged(every: Record, item: StrategyResult) -> Iterator[Record]:
    """Verdict, metrics, slope and cost."""
    verdict, slope = item.verdict, item.slope
    for index, channel in enumerate(CHANNELS):
        yield replace(every, quantity="mean_error", channel=channel, value=float(verdict.error[index]),
                      low=float(verdict.low[index]), high=float(verdict.high[index]))
        yield replace(every, quantity="smallest_detectable", channel=channel,
                      value=float(verdict.smallest_detectable[index]))
    for metric in metrics.METRICS:
        if metric.name in item.scores:
            yield replace(every, quantity=metric.name, channel=metric.channel, value=item.scores[metric.name])
    if slope is not None:
        yield replace(every, samples=int(item.spp[-1]), quantity="slope", value=slope.slope, low=slope.low,
                      high=slope.high, n=slope.replicas)
    yield replace(every, quantity="seconds_per_spp", value=item.seconds_per_spp)
    yield replace(every, quantity="rejected", value=float(item.estimate.rejected))
