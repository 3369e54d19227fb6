"""The executor that does the work in processes of this machine."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from types import TracebackType
from typing import Any

from harness.work.executors import base
from harness.work.executors.base import Item, Prepare, Result, given_up, one_thread


class Processes:
    """So many processes, started afresh: a forked one could not use its parent's GL context."""

    def __init__(self, jobs: int, prepare: Prepare | None = None) -> None:
        self._jobs, self._prepare = jobs, prepare
        self._stack = ExitStack()

    def __enter__(self) -> Processes:
        # Libraries read the environment when they are loaded, before any code of ours runs in the process.
        self._stack.enter_context(one_thread())
        self._pool = self._started()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self._pool.shutdown(cancel_futures=True)
        self._stack.close()

    def _started(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self._jobs, mp_context=multiprocessing.get_context("spawn"),
                                   initializer=begin, initargs=(self._prepare,))

    def _submitted(self, work: Callable[[Item], Result], item: Item) -> Future[Result]:
        """BrokenProcessPool where a process has died already: while the pool finds that out it closes its pipes, and a
        process that is started then meets a closed one."""
        try:
            return self._pool.submit(work, item)
        except OSError as error:
            if error.errno is not None:  # the system's own: no more processes, no memory
                raise
            raise BrokenProcessPool(str(error)) from error

    def map(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """See `Executor.map`. All is handed out at once; a process that dies takes the pool with it, and what was not
        done then goes to the next pool."""
        return self._results(work, dict(enumerate(items)))

    def _results(self, work: Callable[[Item], Result], left: dict[int, Item]) -> Iterator[Result]:
        done: dict[int, Any] = {}
        following, losses = 0, 0
        last = len(left)
        futures: dict[int, Future[Result]] = {}
        try:
            while following < last:
                try:
                    futures = futures or {number: self._submitted(work, item) for number, item in left.items()}
                    if following not in done:
                        done[following] = futures[following].result()
                except BrokenProcessPool:
                    done |= {number: future.result() for number, future in futures.items()
                             if future.done() and not future.cancelled() and future.exception() is None}
                    losses += 1
                    if losses > base.ALLOWED_LOSSES:
                        raise given_up(f"piece {following + 1} of {last}, or one that ran beside it,") from None
                    left = {number: item for number, item in left.items() if number not in done}
                    futures = {}
                    _end(self._pool)
                    self._pool = self._started()
                    continue
                result = done.pop(following)
                left.pop(following, None)
                following, losses = following + 1, 0
                yield result
        finally:
            for future in futures.values():
                future.cancel()


def _end(pool: ProcessPoolExecutor) -> None:
    """End a pool that broke, its processes first: of one that was started meanwhile the pool knows too late, and waits
    without end for it, as it does for work."""
    for process in list((pool._processes or {}).values()):
        process.kill()
    pool.shutdown(wait=True, cancel_futures=True)


def begin(prepare: Prepare | None) -> None:
    """What a process does first: see that it ends with the one that started it, even if that is killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    if prepare:
        prepare()
