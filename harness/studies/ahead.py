"""What a report needs and the cache lacks, made in several processes at a time before it is read back in order."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from harness.progress import Progress, quiet
from harness.samples import spent
from harness.work.executors import executor


@dataclass(frozen=True)
class Part:
    """One of them: what it is called, about how much work it is beside the others, and what makes it and leaves it in
    the cache: picklable, as all that it is given."""

    name: str
    work: float
    make: Callable[[], object]


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
          executor("processes", min(jobs, len(parts))) as pool):
        try:
            for part, table in zip(longest_first, pool.map(_make, longest_first), strict=True):
                elapsed[part.name] = sum(seconds for _, seconds in table)
                tables.append(table)
                advance(part.work)
        except BaseException:  # the others would end their parts first, which takes minutes; the store loses nothing
            for process in multiprocessing.active_children():
                process.terminate()
            raise
    spent.join(tables, waited=time.perf_counter() - began)
    return elapsed


def _make(part: Part) -> list[tuple[str, float]]:
    """What the part's time went to."""
    spending = spent.watch(since_start=False)
    try:
        part.make()
    finally:
        spent.unwatch()
    return spending.table()
