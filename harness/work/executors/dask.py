"""The executor that does the work on a Dask cluster: one of this machine's own, or the one of a scheduler."""

from __future__ import annotations

import logging
import os
import secrets
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Generic

from harness.errors import HarnessError, MachineError
from harness.work.executors import base
from harness.work.executors.base import Item, Options, Prepare, Result, given_up, one_thread, unknown_options

# Dask's own variable for its setting `scheduler-address`.
ADDRESS_VARIABLE = "DASK_SCHEDULER_ADDRESS"
OPTIONS = {"scheduler": "its address, such as tcp://10.0.0.1:8786; a cluster of --jobs processes here if not given"}
# Seconds to wait for a scheduler to answer, and for its first worker.
CONNECT_SECONDS, WORKER_SECONDS = 10, 120
INSTALL = "pip install 'glsl-validation-harness[dask]'"

# What a worker of our own cluster does first: a terminal's Ctrl-C is for the process that started it, which ends it.
DEAF = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"

# Of a worker: the runs that it is prepared for.
_prepared: set[str] = set()


class Dask:
    """A client of a Dask cluster. Workers must have one thread each: a GL context belongs to a thread."""

    def __init__(self, jobs: int, prepare: Prepare | None = None, options: Options | None = None) -> None:
        self._jobs, self._prepare, options = jobs, prepare, options or {}
        unknown_options("dask", options, OPTIONS)
        self._address = str(options.get("scheduler") or os.environ.get(ADDRESS_VARIABLE, ""))
        self._stack = ExitStack()

    def __enter__(self) -> Dask:
        try:
            import distributed
        except ImportError:
            raise MachineError(f"--executor dask needs Dask; install it with: {INSTALL}") from None
        dask: Any = distributed  # which types its functions in part
        with ExitStack() as stack:
            address = self._address or self._cluster(dask, stack)
            try:
                self._client = stack.enter_context(dask.Client(address, timeout=CONNECT_SECONDS, set_as_default=False))
                self._client.wait_for_workers(1, timeout=WORKER_SECONDS)
            except TimeoutError:
                raise HarnessError(f"{address}: no scheduler answers, or it has no worker; start them with `dask "
                                   "scheduler` and, where the workers are to be, `dask worker ADDRESS --nthreads 1`"
                                   ) from None
            except (OSError, ValueError) as error:
                raise HarnessError(f"{address}: no Dask scheduler ({error}); give an address such as "
                                   "tcp://10.0.0.1:8786") from None
            self._stack = stack.pop_all()
        return self

    def _cluster(self, distributed: Any, stack: ExitStack) -> str:
        """A cluster of this machine. Without a limit of memory: Dask would end workers at its own idea of too much.

        The cluster lets go of what starts workers again for one that has been gone for so long, and does so for one
        that is lost a second time just then (distributed 2026.8, `SpecCluster._update_worker_status`): work would wait
        for ever.
        """
        import dask

        stack.enter_context(one_thread())
        stack.enter_context(dask.config.set({"distributed.deploy.lost-worker-timeout": "1000 days",
                                             "distributed.scheduler.allowed-failures": base.ALLOWED_LOSSES}))
        cluster = distributed.LocalCluster(
            n_workers=self._jobs, threads_per_worker=1, processes=True, memory_limit=0, dashboard_address=None,
            silence_logs=logging.CRITICAL, preload=DEAF)
        stack.enter_context(cluster)
        return str(cluster.scheduler_address)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self._stack.close()

    def map(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """See `Executor.map`. Dask itself gives what a lost worker had to another."""
        pieces = list(items)
        futures = self._client.map(_Work(work, self._prepare, secrets.token_hex(8)), pieces, pure=False)
        return self._results(futures)

    def _results(self, futures: list[Any]) -> Iterator[Any]:
        from distributed import CancelledError, KilledWorker

        try:
            for number, future in enumerate(futures):
                try:
                    yield future.result()
                except KilledWorker as error:
                    raise given_up(f"piece {number + 1} of {len(futures)}", losses=error.allowed_failures) from None
                except CancelledError:
                    raise HarnessError("the Dask scheduler went away; what was drawn is kept, and the same command "
                                       "goes on from there") from None
                except ModuleNotFoundError as error:
                    raise HarnessError(f"a Dask worker has no module '{error.name}'; install there what is installed "
                                       "here, this package too") from None
        finally:
            self._client.cancel(futures, force=True)


@dataclass(frozen=True)
class _Work(Generic[Item, Result]):
    """Work as a worker does it. `run`: whose preparation it needs."""

    work: Callable[[Item], Result]
    prepare: Prepare | None
    run: str

    def __call__(self, item: Item) -> Result:
        from distributed import get_worker

        worker = get_worker()
        if (threads := worker.state.nthreads) != 1:
            raise HarnessError(f"the Dask worker {worker.address} has {threads} threads, and a GL context belongs to "
                               "one; start it with `dask worker ADDRESS --nthreads 1`")
        if self.prepare and self.run not in _prepared:
            self.prepare()
            _prepared.add(self.run)
        return self.work(item)
