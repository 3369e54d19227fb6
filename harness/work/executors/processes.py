"""The executor that does the work in processes of this machine."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from types import TracebackType

from harness.work.executors.base import Item, Prepare, Result

# With processes enough, threads inside each only wait for each other: OpenBLAS multiplies matrices, llvmpipe draws.
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "LP_NUM_THREADS": "1"}


class Processes:
    """So many processes, started afresh: a forked one could not use its parent's GL context.

    What the user set in the environment wins over `ONE_THREAD`.
    """

    def __init__(self, jobs: int, prepare: Prepare | None = None) -> None:
        self._jobs, self._prepare = jobs, prepare
        self._set: list[str] = []

    def __enter__(self) -> Processes:
        # Libraries read these when they are loaded, before any code of ours runs in the process.
        self._set = [name for name in ONE_THREAD if name not in os.environ]
        os.environ.update({name: ONE_THREAD[name] for name in self._set})
        self._pool = ProcessPoolExecutor(self._jobs, mp_context=multiprocessing.get_context("spawn"),
                                         initializer=self._prepare)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self._pool.shutdown(cancel_futures=True)
        for name in self._set:
            del os.environ[name]

    def map(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """See `Executor.map`."""
        return self._pool.map(work, items)
