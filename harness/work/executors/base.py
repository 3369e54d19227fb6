"""What an executor is."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Protocol, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")
# What a worker does once before its first piece of work; picklable.
Prepare = Callable[[], None]


class Executor(Protocol):
    """Does pieces of work that do not depend on each other; open only inside its `with`."""

    def map(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """The results in the order of `items`, each as soon as it and all before it are there.

        `work` and items are picklable; an exception of `work` is raised where its result would be.
        """
        ...
