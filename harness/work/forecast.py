"""What a long run will cost, told from its first samples, and how far that was off on the samples after them."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Literal

import numpy as np

from harness.errors import HarnessError
from harness.estimators.base import Renderer
from harness.progress import Advance
from harness.samples.store import Store
from harness.work.batches import batches

# A pilot's samples per pixel at the least, its seconds at the least, and its samples at the most, where they take less.
PILOT, PILOT_SECONDS, LONGEST_PILOT = 64, 10.0, 4096


@dataclass(frozen=True)
class Forecast:
    """A model of what work costs on one device: `setup` seconds a worker, `per_batch` a batch and `per_sample` a sample
    per pixel, all by the `clock` that counts there, fitted to a pilot of `pilot` samples.

    `foretold`, `took`: seconds of the pilot's second half, as its first half alone would have them, and as they were.
    """

    device: str
    clock: str
    setup: float
    per_batch: float
    per_sample: float
    pilot: int
    foretold: float
    took: float

    @property
    def error(self) -> float:
        """By how much half a pilot was off on what it had not seen, relative to what that took."""
        return self.foretold / self.took - 1

    def seconds(self, counts: Sequence[int], workers: int = 1) -> float:
        """Of all workers together, for batches of so many samples per pixel each."""
        return workers * self.setup + sum(self.per_batch + self.per_sample * count for count in counts)

    def longest(self, counts: Sequence[int], workers: int) -> float:
        """Of the worker that ends last, each taking the next batch when it is done with one."""
        busy = [self.setup] * min(workers, len(counts))
        for count in counts:
            heapq.heapreplace(busy, busy[0] + self.per_batch + self.per_sample * count)
        return max(busy)


def forecast(renderer: Renderer, store: Store, setup: float, advance: Advance = lambda n: None) -> Forecast:
    """Fitted to a pilot, which is the beginning of any run: at least `PILOT` samples per pixel and `PILOT_SECONDS`.

    `setup`: seconds that a worker spends until its renderer is open; to it is added by how much the first batch was
    dearer than the others (drivers compile then). HarnessError where the clock was not read, or on several devices.
    """
    counts, seconds = [], []
    devices: dict[tuple[str, Literal["cpu", "gpu"]], None] = {}
    with closing(batches(renderer, LONGEST_PILOT, store=store, advance=advance)) as drawn:
        for batch in drawn:
            counts.append(batch.samples)
            seconds.append(batch.cost.seconds)
            devices[batch.cost.device, batch.cost.clock] = None
            if len(devices) > 1 or not math.isfinite(seconds[-1]):
                known = ", ".join(device for device, _ in devices if device) or "no device that is known"
                raise HarnessError(f"the pilot was drawn on {known}; a cost is told of one, whose clock is read: "
                                   "remove its batches (`harness store prune`), or ask there")
            if sum(counts) >= PILOT and sum(seconds) >= PILOT_SECONDS:
                break
    half = next(number for number in range(len(counts)) if 2 * sum(counts[:number]) >= sum(counts))
    per_batch, per_sample = _fitted(counts[1:half], seconds[1:half])
    foretold = sum(per_batch + per_sample * count for count in counts[half:])
    per_batch, per_sample = _fitted(counts[1:], seconds[1:])
    first = max(0.0, seconds[0] - per_batch - per_sample * counts[0])
    ((device, clock),) = devices
    return Forecast(device, clock, setup + first, per_batch, per_sample, sum(counts), foretold, sum(seconds[half:]))


def _fitted(counts: Sequence[int], seconds: Sequence[float]) -> tuple[float, float]:
    """Seconds a batch and a sample by least squares, neither below 0; longer batches scatter more, in proportion to
    their samples."""
    weight = 1 / np.sqrt(np.asarray(counts, dtype=np.float64))
    design = np.stack([np.ones(len(counts)), np.asarray(counts, dtype=np.float64)], axis=1) * weight[:, None]
    per_batch, per_sample = np.linalg.lstsq(design, np.asarray(seconds) * weight, rcond=None)[0]
    if per_batch < 0 or per_sample < 0:
        return 0.0, float(sum(seconds) / sum(counts))
    return float(per_batch), float(per_sample)
