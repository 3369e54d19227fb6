"""The executor that does the work here and now."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from types import TracebackType

from harness.work.executors.base import Item, Prepare, Result


class Serial:
    """One piece of work after the other, in this process."""

    def __init__(self, prepare: Prepare | None = None) -> None:
        self._prepare = prepare

    def __enter__(self) -> Serial:
        if self._prepare:
            self._prepare()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        """Nothing is held."""

    def map(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """See `Executor.map`."""
        return map(work, items)
