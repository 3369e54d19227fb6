"""The executor that does the work in jobs of a Slurm cluster, through submitit."""

from __future__ import annotations

import pickle
import secrets
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from harness.errors import HarnessError, MachineError
from harness.files import cache_dir, write_atomically
from harness.work.executors import base
from harness.work.executors.base import Item, Options, Prepare, Result, given_up, one_thread

INSTALL = "pip install 'glsl-validation-harness[slurm]'"
# Minutes that a job may take where none are asked for; one that runs out of them is begun again where it was.
DEFAULT_MINUTES = 240
# Our words, besides submitit's; `timeout_min`, `mem_gb`, … are its own, the others are sbatch's.
CLUSTER, FOLDER, TIME = "cluster", "folder", "time"
# What stands for a cluster where there is none: processes of this machine, and this process.
LOCAL, DEBUG = "local", "debug"
# How often it is looked whether a result is there.
POLL_SECONDS = 0.5
# What Slurm sends to a job 90 seconds before it runs out of time, as submitit asks it to.
WARNING = signal.SIGUSR2
# Seconds that a job may take to end when it has nothing more to do.
ENDING_SECONDS = 30
# What submitit knows of every cluster; the rest is Slurm's.
COMMON = ("name", "timeout_min", "mem_gb", "nodes", "cpus_per_task", "gpus_per_node", "tasks_per_node")


def keeps_accounts() -> bool:
    """Whether `sacct` answers, by which submitit sees what became of jobs: small clusters often have no accounting."""
    try:
        return subprocess.run(["sacct", "--noheader", "--jobs=1"], capture_output=True).returncode == 0
    except OSError:
        return False


class Slurm:
    """So many jobs, each with a share of the work; results come through files, as soon as each is there.

    `options`: what `sbatch` takes (`partition`, `time` in minutes, `account`, `qos`, `constraint`, …) and submitit
    (`mem_gb`, `cpus_per_task`, `gpus_per_node`); `folder` for its files and the jobs' output, on a disk that all nodes
    share, in the cache if not given; `cluster=local` runs the jobs as processes of this machine.
    """

    def __init__(self, jobs: int, prepare: Prepare | None = None, options: Options | None = None) -> None:
        self._jobs, self._prepare, self._options = jobs, prepare, dict(options or {})
        self._cluster = str(self._options.pop(CLUSTER, "slurm"))
        folder = self._options.pop(FOLDER, None)
        self._folder = (Path(str(folder)).absolute() if folder else cache_dir() / "slurm") / secrets.token_hex(4)
        self._running: list[Any] = []

    def __enter__(self) -> Slurm:
        try:
            import submitit
        except ImportError:
            raise MachineError(f"--executor slurm needs submitit; install it with: {INSTALL}") from None
        if self._cluster not in (allowed := ("slurm", LOCAL, DEBUG)):
            raise HarnessError(f"--cluster: cluster is '{self._cluster}'; allowed: {', '.join(allowed)}")
        if self._cluster == "slurm" and not shutil.which("sbatch"):
            raise MachineError("--executor slurm found no `sbatch` on this machine; run it where Slurm jobs are "
                               "submitted, or try it here with --cluster cluster=local")
        if self._cluster == "slurm" and not keeps_accounts():
            from harness.work.executors.queue import Queue

            submitit.SlurmJob.watcher = Queue()
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
            if not job.done():
                job.cancel(check=False)
        if error is None:
            shutil.rmtree(self._folder, ignore_errors=True)

    def map(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """See `Executor.map`. Of N jobs each has every N-th item, so that results come in their order from all."""
        return self._results(work, list(items))

    def _results(self, work: Callable[[Item], Result], pieces: Sequence[Item]) -> Iterator[Result]:
        place = self._folder / f"results-{secrets.token_hex(4)}"
        place.mkdir()
        count = min(self._jobs, len(pieces))
        shares = [{number: pieces[number] for number in range(first, len(pieces), count)} for first in range(count)]
        jobs = self._submitted(work, shares, place)
        losses = [0] * count
        for number in range(len(pieces)):
            turn = number % count
            while (outcome := _outcome(place, number)) is None:
                if not jobs[turn].done():
                    time.sleep(POLL_SECONDS)
                    continue
                if (outcome := _outcome(place, number)) is not None:
                    break
                self._require_lost(jobs[turn])
                losses[turn] += 1
                if losses[turn] > base.ALLOWED_LOSSES:
                    raise given_up(f"piece {number + 1} of {len(pieces)}", f"; see {self._folder}")
                left = {other: pieces[other] for other in range(number, len(pieces), count)}
                (jobs[turn],) = self._submitted(work, [left], place)
            losses[turn] = 0
            error, result = outcome
            if error is not None:
                raise error
            yield result
        self._let_end(jobs)

    def _let_end(self, jobs: Sequence[Any]) -> None:
        """Of jobs that have left all their results: they write a last file, into a folder that is then removed."""
        patience = time.monotonic() + ENDING_SECONDS
        while time.monotonic() < patience and not all(job.done() for job in jobs):
            time.sleep(POLL_SECONDS)
        self._running = [job for job in self._running if job not in jobs]

    def _submitted(self, work: Callable[[Item], Result], shares: Sequence[Mapping[int, Item]],
                   place: Path) -> list[Any]:
        if not shares:
            return []
        with one_thread(), self._executor.batch():
            jobs = [self._executor.submit(_share, work, self._prepare, share, place, told=self._cluster != DEBUG)
                    for share in shares]
        self._running += jobs
        if self._cluster == DEBUG:  # whose jobs begin when they are asked for what they return
            for job in jobs:
                job.result()
        return jobs

    def _require_lost(self, job: Any) -> None:
        """Of a job that ended without the result that is next: HarnessError unless it was killed, or told to end."""
        from submitit.core.utils import FailedJobError, UncompletedJobError

        try:
            if not job.result():
                return
        except UncompletedJobError:
            return
        except FailedJobError as error:  # errors of the work come as results: this is one of the job around it
            told = [line for line in str(error).splitlines() if line.strip() and "---" not in line]
            last = next((line for line in told if "Error" in line and "trace" not in line), told[0])
            raise HarnessError(f"a job failed: {last.strip()}; see {job.paths.stderr}") from None
        raise HarnessError(f"a job ended, and its results are not to be seen in {self._folder}; name a folder on a "
                           "disk that all nodes share with --cluster folder=PLACE")


def _share(work: Callable[[Item], Result], prepare: Prepare | None, share: Mapping[int, Item], place: Path,
           *, told: bool) -> bool:
    """What a job does: leaves (None, the result) of each item, by its number, and (the error, None) of the first that
    has one, its last. False where it was `told` to end before the last."""
    ending = _told_to_end() if told else lambda: False
    failed: Exception | None = None
    try:
        if prepare:
            prepare()
    except Exception as error:
        failed = error
    for number, item in share.items():
        if ending():
            return False
        result = None
        try:
            result = work(item) if failed is None else None
        except Exception as error:
            failed = error
        with write_atomically(place / f"{number}.pickle") as partial:
            partial.write_bytes(pickle.dumps((failed, result)))
        if failed is not None:
            return True
    return True


def _told_to_end() -> Callable[[], bool]:
    """Whether this job has been told that its time will soon be over, or that another needs its place.

    In place of submitit's answer to that signal, an exception wherever the work stands: what is being done is done to
    its end, if there is time for it, and another job goes on with the rest.
    """
    heard = threading.Event()
    signal.signal(WARNING, lambda number, frame: heard.set())
    return heard.is_set


def _outcome(place: Path, number: int) -> Any:
    """What a job left of an item; None where it has not come so far."""
    try:
        content = (place / f"{number}.pickle").read_bytes()
    except FileNotFoundError:
        return None
    return pickle.loads(content)
