"""What a report needs and the cache lacks, made in several processes at a time before it is read back in order."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from harness.gpu.width import ask
from harness.progress import Progress, quiet
from harness.samples import spent
from harness.work.executors import executor


@dataclass(frozen=True)
class Part:
    """One of them: what it is called, about how much work it is beside the others, and what makes it and leaves it in
    the cache: picklable, as all that it is given. `fragments`: whether it draws fragment shaders, too."""

    name: str
    work: float
    make: Callable[[], object]
    fragments: bool = False


def make_ahead(parts: Sequence[Part], jobs: int, progress: Progress = quiet) -> dict[str, float]:
    """Make all of them in `jobs` processes, the longest first; the seconds that each took, by its name.

    A Mitsuba kernel is compiled on one core, and so are metrics and statistics computed: where several parts are at
    work, the others are not idle meanwhile. Raises what a part raises.
    """
    if not parts:
        return {}
    longest_first = sorted(parts, key=lambda part: part.work, reverse=True)
    elapsed, tables = {}, []
    began = time.perf_counter()
    with (progress(sum(part.work for part in parts), f"{len(parts)} parts, {jobs} at a time") as advance,
          executor("processes", min(jobs, len(parts)), ask) as pool):
        try:
            for part, table in zip(longest_first, pool.map(_placed, longest_first), strict=True):
                elapsed[part.name] = sum(seconds for _, seconds in table)
                tables.append(table)
                advance(part.work)
        except BaseException:  # the others would end their parts first, which takes minutes; the store loses nothing
            for process in multiprocessing.active_children():
                process.terminate()
            raise
    spent.join(tables, waited=time.perf_counter() - began)
    return elapsed


def _placed(part: Part) -> list[tuple[str, float]]:
    """As `_make`; fragments are drawn in a process that has not asked for the vectors in which they crash."""
    if not part.fragments:
        return _make(part)
    with executor("processes") as own:
        return next(own.map(_make, [part]))


def _make(part: Part) -> list[tuple[str, float]]:
    """What the part's time went to."""
    spending = spent.watch(since_start=False)
    try:
        part.make()
    finally:
        spent.unwatch()
    return spending.table()
