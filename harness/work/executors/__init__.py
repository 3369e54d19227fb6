"""Where work is done: in this process, or in others, by one small door.

To add an executor, write a context manager with a `map` into a file of its own, and put it into `EXECUTORS`. Results
never depend on the executor: what is drawn is numbered, and what is kept is found by its content.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

from harness.errors import HarnessError
from harness.work.executors.base import Executor, Prepare
from harness.work.executors.processes import Processes
from harness.work.executors.serial import Serial

# By the word that chooses it; each takes how many workers there are to be, and what a worker does first.
EXECUTORS: dict[str, Callable[[int, Prepare | None], AbstractContextManager[Executor]]] = {
    "serial": lambda jobs, prepare: Serial(prepare),
    "processes": lambda jobs, prepare: Processes(jobs, prepare),
}


def executor(name: str, jobs: int = 1, prepare: Prepare | None = None) -> AbstractContextManager[Executor]:
    """The executor of that name. HarnessError for a word that is none."""
    if name not in EXECUTORS:
        raise HarnessError(f"unknown executor '{name}'; choose from {', '.join(EXECUTORS)}")
    return EXECUTORS[name](jobs, prepare)


__all__ = ["EXECUTORS", "Executor", "Prepare", "Processes", "Serial", "executor"]
