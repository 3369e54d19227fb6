"""What an executor is, and what all of them hold to."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Protocol, TypeVar

from harness.errors import HarnessError

Item = TypeVar("Item")
Result = TypeVar("Result")
# What a worker does once before its first piece of work; picklable.
Prepare = Callable[[], None]
# What an executor is told besides how many workers there are to be: a scheduler's address, a partition, …
Options = Mapping[str, str | int | float]

# With workers enough, threads inside each only wait for each other: OpenBLAS multiplies matrices, llvmpipe draws.
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "LP_NUM_THREADS": "1"}
# How many workers one piece of work may take with it before it is given up, besides the first. A worker is lost by
# chance (a node, the machine's memory); four in a row are lost by what they do. Dask's own number.
ALLOWED_LOSSES = 3


class Executor(Protocol):
    """Does pieces of work that do not depend on each other; open only inside its `with`."""

    def map(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """The results in the order of `items`, each as soon as it and all before it are there.

        `work` and items are picklable; an exception of `work` is raised where its result would be. What a worker had
        begun when it was lost (killed, crashed, out of memory) is done again by another; HarnessError for what
        has cost `ALLOWED_LOSSES` workers more than one.
        """
        ...


@contextmanager
def one_thread() -> Iterator[None]:
    """Processes that are started meanwhile have one thread each; what the user set in the environment wins."""
    ours = [name for name in ONE_THREAD if name not in os.environ]
    os.environ.update({name: ONE_THREAD[name] for name in ours})
    try:
        yield
    finally:
        for name in ours:
            del os.environ[name]


def given_up(what: str, where: str = "", losses: int | None = None) -> HarnessError:
    """What to say of work that takes every worker with it. `losses`: how many more than one, if not as many as are
    allowed."""
    workers = 1 + (ALLOWED_LOSSES if losses is None else losses)
    return HarnessError(f"{what} ended {workers} workers one after the other (killed, crashed, or out of "
                        f"memory){where}; what was drawn is kept; if memory is short, try fewer --jobs or a smaller "
                        "--size")


def unknown_options(executor: str, options: Options, allowed: Mapping[str, str]) -> None:
    """HarnessError for an option that an executor does not know. `allowed`: each with what it is."""
    if wrong := sorted(options.keys() - allowed.keys()):
        words = ", ".join(f"{name} ({what})" for name, what in allowed.items()) or "none"
        raise HarnessError(f"--cluster: executor '{executor}' knows no '{wrong[0]}'; allowed: {words}")
