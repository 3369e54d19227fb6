"""Where a run's elapsed time goes, by what it is spent on: told by `--profile-time`."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

# What renderers are called here; all else is around them.
RENDERERS = ("tracer", "Mitsuba", "Mitsuba, coupled", "program", "shader of others")
START, REST = "Python and its packages, before the command", "else"


@dataclass
class Spending:
    """Seconds by what they were spent on, of one thread; of nested spans each second counts for the innermost."""

    began: float
    seconds: dict[str, float] = field(default_factory=dict)
    _thread: int = field(default_factory=threading.get_ident)
    _spans: list[str] = field(default_factory=list)
    _since: float = field(default_factory=time.perf_counter)

    @contextmanager
    def span(self, name: str) -> Iterator[None]:
        """What is done within counts for `name`; nothing where another thread does it beside this one."""
        if threading.get_ident() != self._thread:
            yield
            return
        self._charge()
        self._spans.append(name)
        try:
            yield
        finally:
            self._charge()
            self._spans.pop()

    def table(self) -> list[tuple[str, float]]:
        """What the time went to, the most first, and last what no span was about."""
        whole = time.perf_counter() - self.began
        named = sorted(((name, seconds) for name, seconds in self.seconds.items() if name != REST),
                       key=lambda item: -item[1])
        return [*named, (REST, max(0.0, whole - sum(seconds for _, seconds in named)))]

    def join(self, tables: Iterable[Iterable[tuple[str, float]]], waited: float) -> None:
        """Count what other processes spent, in place of the seconds that were `waited` for them."""
        for name, seconds in chain.from_iterable(tables):
            self.seconds[name] = self.seconds.get(name, 0.0) + seconds
            self.began -= seconds
        self.began += waited

    def outside(self) -> float:
        """The share of the elapsed time in which no renderer was at work."""
        rows = self.table()
        whole = sum(seconds for _, seconds in rows)
        return 1 - sum(seconds for name, seconds in rows if name in RENDERERS) / whole if whole else 0.0

    def _charge(self) -> None:
        now = time.perf_counter()
        if self._spans:
            self.seconds[self._spans[-1]] = self.seconds.get(self._spans[-1], 0.0) + now - self._since
        self._since = now


_spending: Spending | None = None


def watch(*, since_start: bool = True) -> Spending:
    """Begin to count on this thread, from when the process began, or from now."""
    global _spending
    before = _age() if since_start else 0.0
    _spending = Spending(time.perf_counter() - before, {START: before} if before else {})
    return _spending


def unwatch() -> None:
    """End it: spans are free again."""
    global _spending
    _spending = None


def join(tables: Iterable[Iterable[tuple[str, float]]], waited: float) -> None:
    """See `Spending.join`; nothing where nobody watches."""
    if _spending is not None:
        _spending.join(tables, waited)


@contextmanager
def spent(name: str) -> Iterator[None]:
    """Count what is done within for `name`, where anyone watches. Also a decorator."""
    if _spending is None:
        yield
    else:
        with _spending.span(name):
            yield


def _age() -> float:
    """Seconds since this process began, where Linux tells; 0 elsewhere."""
    try:
        started = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
        return max(0.0, time.clock_gettime(time.CLOCK_BOOTTIME) - started / os.sysconf("SC_CLK_TCK"))
    except (OSError, ValueError, AttributeError, IndexError):
        return 0.0
