"""What a long run will cost, told from its first samples, and how far that was off on the samples after them."""

from __future__ import annotations

import heapq
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.errors import HarnessError
from harness.estimators.base import Renderer
from harness.progress import Advance
from harness.samples.store import Store
from harness.work.batches import batches

# Samples per pixel of a pilot: its last batch, half of them, is what the model, fitted to the others, must foretell.
PILOT = 64


@dataclass(frozen=True)
class Forecast:
    """A model of what work costs on one device: `setup` seconds a worker, `per_batch` a batch and `per_sample` a sample
    per pixel, all by the `clock` that counts there.

    `foretold`, `took`: seconds of the batch that the model was not fitted to.
    """

    device: str
    clock: str
    setup: float
    per_batch: float
    per_sample: float
    foretold: float
    took: float

    @property
    def error(self) -> float:
        """By how much it was off on what it had not seen, relative to what that took."""
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


def forecast(renderer: Renderer, store: Store, advance: Advance = lambda n: None) -> Forecast:
    """Fitted to the first half of a pilot of `PILOT` samples per pixel, and held against the second.

    The set-up is what this process has spent so far, which is what a worker will, and by how much its first batch was
    dearer than the others (drivers compile then). HarnessError where the clock was not read, or on several devices.
    """
    setup = time.process_time()
    drawn = list(batches(renderer, PILOT, store=store, advance=advance))
    devices = {batch.cost.device for batch in drawn}
    seconds = [batch.cost.seconds for batch in drawn]
    if len(devices) != 1 or not all(map(math.isfinite, seconds)):
        raise HarnessError(f"the pilot was drawn on {', '.join(sorted(devices)) or 'no device that is known'}; a cost "
                           "is told of one, whose clock is read: remove its batches (`harness store prune`), or ask "
                           "there")
    counts = [batch.samples for batch in drawn]
    per_batch, per_sample = _fitted(counts[1:-1], seconds[1:-1])
    first = max(0.0, seconds[0] - per_batch - per_sample * counts[0])
    return Forecast(devices.pop(), drawn[0].cost.clock, setup + first, per_batch, per_sample,
                    per_batch + per_sample * counts[-1], seconds[-1])


def _fitted(counts: Sequence[int], seconds: Sequence[float]) -> tuple[float, float]:
    """Seconds a batch and a sample by least squares, neither below 0; longer batches scatter more, in proportion to
    their samples."""
    weight = 1 / np.sqrt(np.asarray(counts, dtype=np.float64))
    design = np.stack([np.ones(len(counts)), np.asarray(counts, dtype=np.float64)], axis=1) * weight[:, None]
    per_batch, per_sample = np.linalg.lstsq(design, np.asarray(seconds) * weight, rcond=None)[0]
    if per_batch < 0 or per_sample < 0:
        return 0.0, float(sum(seconds) / sum(counts))
    return float(per_batch), float(per_sample)
