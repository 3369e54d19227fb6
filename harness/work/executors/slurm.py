"""The executor that does the work in jobs of a Slurm cluster, through submitit."""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

from harness.errors import HarnessError, MachineError
from harness.files import cache_dir
from harness.work.executors import base
from harness.work.executors.base import Item, Options, Prepare, Result, given_up, one_thread

INSTALL = "pip install 'glsl-validation-harness[slurm]'"
# Minutes that a job may take where none are asked for; one that runs out of them is begun again where it was.
DEFAULT_MINUTES = 240
# Our words, besides submitit's; `timeout_min`, `mem_gb`, … are its own, the others are sbatch's.
CLUSTER, FOLDER, TIME = "cluster", "folder", "time"
# What submitit knows of every cluster; the rest is Slurm's.
COMMON = ("name", "timeout_min", "mem_gb", "nodes", "cpus_per_task", "gpus_per_node", "tasks_per_node")


class Slurm:
    """So many jobs, each with a share of the work; their results come when they end.

    `options`: what `sbatch` takes (`partition`, `time` in minutes, `account`, `qos`, `constraint`, …) and submitit
    (`mem_gb`, `cpus_per_task`, `gpus_per_node`); `folder` for its files and the jobs' output, on a disk that all nodes
    share, in the cache if not given; `cluster=local` runs the jobs as processes of this machine.
    """

    def __init__(self, jobs: int, prepare: Prepare | None = None, options: Options | None = None) -> None:
        self._jobs, self._prepare, self._options = jobs, prepare, dict(options or {})
        self._cluster = str(self._options.pop(CLUSTER, "slurm"))
        folder = self._options.pop(FOLDER, None)
        self._folder = (Path(str(folder)).absolute() if folder else cache_dir() / "slurm") / secrets.token_hex(4)
        self._stack = ExitStack()
        self._running: list[Any] = []

    def __enter__(self) -> Slurm:
        try:
            import submitit
        except ImportError:
            raise MachineError(f"--executor slurm needs submitit; install it with: {INSTALL}") from None
        if self._cluster not in (allowed := ("slurm", "local", "debug")):
            raise HarnessError(f"--cluster: cluster is '{self._cluster}'; allowed: {', '.join(allowed)}")
        if self._cluster == "slurm" and not shutil.which("sbatch"):
            raise MachineError("--executor slurm found no `sbatch` on this machine; run it where Slurm jobs are "
                               "submitted, or try it here with --cluster cluster=local")
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._executor = submitit.AutoExecutor(self._folder, cluster=self._cluster)
            self._executor.update_parameters(**self._parameters())
        except (NameError, AssertionError, TypeError) as error:
            raise HarnessError(f"--cluster: submitit refuses this: {' '.join(str(error).split())}") from None
        except OSError as error:
            raise HarnessError(f"{self._folder}: cannot be made ({error.strerror}); name another with --cluster "
                               "folder=PLACE, on a disk that all nodes share") from None
        return self

    def _parameters(self) -> dict[str, Any]:
        """The options in submitit's words."""
        given = dict(self._options)
        minutes = given.pop(TIME, DEFAULT_MINUTES)
        return {"timeout_min": minutes, **{name if name in COMMON else f"slurm_{name}": value
                                           for name, value in given.items()}}

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        for job in self._running:
            job.cancel(check=False)
        if error is None:
            shutil.rmtree(self._folder, ignore_errors=True)

    def map(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """See `Executor.map`. Each job has neighbouring items, as many as the others."""
        pieces = list(items)
        if not pieces:
            return iter(())
        each = -(-len(pieces) // self._jobs)
        shares = [pieces[first:first + each] for first in range(0, len(pieces), each)]
        jobs = self._submitted(work, shares)
        return self._results(work, list(zip(shares, jobs, strict=True)))

    def _submitted(self, work: Callable[[Item], Result], shares: Sequence[Sequence[Item]]) -> list[Any]:
        with one_thread(), self._executor.batch():
            jobs = [self._executor.submit(_share, work, self._prepare, share) for share in shares]
        self._running += jobs
        return jobs

    def _results(self, work: Callable[[Item], Result],
                 pairs: Sequence[tuple[Sequence[Item], Any]]) -> Iterator[Result]:
        for share, job in pairs:
            for error, result in self._outcomes(work, share, job):
                if error is not None:
                    raise error
                yield result

    def _outcomes(self, work: Callable[[Item], Result], share: Sequence[Item], job: Any) -> list[Any]:
        """What a job says of each of its items up to the first error; it is begun again where it ends without one."""
        from submitit.core.utils import FailedJobError, UncompletedJobError

        for _ in range(base.ALLOWED_LOSSES + 1):
            try:
                return list(job.result())
            except UncompletedJobError:
                (job,) = self._submitted(work, [share])
            except FailedJobError as error:  # errors of the work come as results: this is one of the job around it
                told = [line for line in str(error).splitlines() if line.strip() and "---" not in line]
                last = next((line for line in told if "Error" in line and "trace" not in line), told[0])
                raise HarnessError(f"a job failed: {last.strip()}; see {job.paths.stderr}") from None
            finally:
                if job in self._running and job.done():
                    self._running.remove(job)
        raise given_up(f"one of the {len(share)} pieces of a job", f"; see {self._folder}")


def _share(work: Callable[[Item], Result], prepare: Prepare | None, share: Sequence[Item]) -> list[Any]:
    """What a job does: (None, the result) of each item, and (the error, None) of the first that has one, which is its
    last."""
    found: list[Any] = []
    try:
        if prepare:
            prepare()
        for item in share:
            found.append((None, work(item)))
    except Exception as error:
        found.append((error, None))
    return found
