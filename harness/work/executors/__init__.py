"""Where work is done: in this process, in others, on a cluster, by one small door.

To add an executor, write a context manager with a `map` into a file of its own, and put it into `EXECUTORS`. Results
never depend on the executor: what is drawn is numbered, and what is kept is found by its content.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

from harness.errors import HarnessError
from harness.work.executors.base import Executor, Options, Prepare, unknown_options
from harness.work.executors.dask import Dask
from harness.work.executors.processes import Processes
from harness.work.executors.serial import Serial
from harness.work.executors.slurm import Slurm

Opened = AbstractContextManager[Executor]


def _serial(jobs: int, prepare: Prepare | None, options: Options) -> Opened:
    unknown_options("serial", options, {})
    return Serial(prepare)


def _processes(jobs: int, prepare: Prepare | None, options: Options) -> Opened:
    unknown_options("processes", options, {})
    return Processes(jobs, prepare)


# By the word that chooses it; each takes how many workers there are to be, what a worker does first, and its options.
EXECUTORS: dict[str, Callable[[int, Prepare | None, Options], Opened]] = {
    "serial": _serial, "processes": _processes, "dask": Dask, "slurm": Slurm,
}


def executor(name: str, jobs: int = 1, prepare: Prepare | None = None, options: Options | None = None) -> Opened:
    """The executor of that name. HarnessError for a word that is none, and for options that it does not know;
    MachineError, when it is entered, where its package is missing."""
    if name not in EXECUTORS:
        raise HarnessError(f"unknown executor '{name}'; choose from {', '.join(EXECUTORS)}")
    return EXECUTORS[name](jobs, prepare, options or {})


__all__ = ["EXECUTORS", "Executor", "Options", "Prepare", "Processes", "Serial", "executor"]
