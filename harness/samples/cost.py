"""What samples cost: seconds by every clock, and the device on which they were spent."""

from __future__ import annotations

import math
import platform
import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache, reduce
from operator import add
from pathlib import Path
from typing import Literal


@dataclass(frozen=True)
class Cost:
    """Seconds that samples took: `wall` by the clock, `cpu` of all threads, `gpu` by the device's timers (or None).

    `clock`: the one that counts on `device`. Seconds of two devices have no sum: it is unknown.
    """

    wall: float
    cpu: float
    gpu: float | None
    device: str
    clock: Literal["cpu", "gpu"]

    @classmethod
    def unknown(cls) -> Cost:
        """Of what nobody measured, or measured on several devices."""
        return cls(math.nan, math.nan, None, "", "cpu")

    @property
    def seconds(self) -> float:
        """By the clock that counts on the device; NaN where it was not read."""
        if self.clock == "cpu":
            return self.cpu
        return math.nan if self.gpu is None else self.gpu

    def __add__(self, other: Cost) -> Cost:
        """Together, on one device; unknown across devices."""
        if not self.device or (self.device, self.clock) != (other.device, other.clock):
            return Cost.unknown()
        gpu = None if self.gpu is None or other.gpu is None else self.gpu + other.gpu
        return Cost(self.wall + other.wall, self.cpu + other.cpu, gpu, self.device, self.clock)


class Watch:
    """Runs from when it is made; reads this process's clocks."""

    def __init__(self) -> None:
        self._wall, self._cpu = time.perf_counter(), time.process_time()

    def cost(self, device: str, gpu: float | None = None, clock: Literal["cpu", "gpu"] = "cpu") -> Cost:
        """What has been spent since, on that device."""
        return Cost(time.perf_counter() - self._wall, time.process_time() - self._cpu, gpu, device, clock)


def total(costs: Iterable[Cost]) -> Cost:
    """The sum; unknown of none, and across devices."""
    held = list(costs)
    return reduce(add, held) if held else Cost.unknown()


@cache
def cpu() -> str:
    """This machine's processor as a device's name, so that two machines that share a store are told apart."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return f"cpu: {next(models, '') or platform.processor() or platform.machine()}"
