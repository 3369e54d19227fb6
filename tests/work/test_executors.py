"""Executors: the same results wherever the work is done, errors that come home, and workers that are lost."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import _ExecutorManagerThread
from multiprocessing.context import SpawnProcess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from harness.errors import HarnessError, MachineError, SceneError
from harness.estimators.tracer import Tracer
from harness.files import data_dir
from harness.samples.estimate import Estimate
from harness.samples.store import Store
from harness.scene import SceneFile
from harness.studies.study import study
from harness.work.executors import EXECUTORS, Executor, base, executor
from harness.work.executors.base import ONE_THREAD
from harness.work.executors.processes import Processes
from harness.work.tasks import draw, tasks_of
from tests.support.work import deadly, deadly_once, mark, marked, picky, process, square, warned

SPHERES = SceneFile(data_dir("mitsuba_scenes") / "spheres.xml", size=(24, 18))
# Slurm's jobs in this process; those of another are `TestSlurm`'s.
OPTIONS = {"slurm": {"cluster": "debug"}}


@pytest.fixture(scope="module", params=EXECUTORS)
def workers(request: pytest.FixtureRequest) -> Iterator[Executor]:
    """Two workers of each kind, prepared by `mark`; a piece of work may cost two workers and no third."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(base, "ALLOWED_LOSSES", 1)
        patch.setenv("HARNESS_TEST_MARK", "not yet")
        with executor(request.param, 2, mark, OPTIONS.get(request.param, {})) as opened:
            yield opened


class TestEach:
    """What all of them do."""

    def test_results_come_in_the_order_of_the_work(self, workers: Executor) -> None:
        assert list(workers.map(square, range(20))) == [number**2 for number in range(20)]
        assert list(workers.map(square, [])) == []

    def test_an_error_comes_where_its_result_would(self, workers: Executor) -> None:
        results = workers.map(picky, range(5))
        assert [next(results) for _ in range(3)] == [0, 1, 2]
        with pytest.raises(SceneError, match=r"three\.xml:3: no such scene file"):
            next(results)

    def test_a_worker_prepares_itself_first(self, workers: Executor) -> None:
        assert list(workers.map(marked, range(2))) == ["prepared"] * 2

    @pytest.mark.parametrize("workers", ["processes", "dask"], indirect=True)
    def test_what_a_lost_worker_had_is_done_again(self, workers: Executor, tmp_path: Path) -> None:
        traces = ["", "", str(tmp_path / "trace"), "", ""]
        assert list(workers.map(deadly_once, traces)) == traces
        assert (tmp_path / "trace").exists()

    @pytest.mark.parametrize("workers", ["processes"], indirect=True)
    def test_losses_of_other_work_do_not_count(self, workers: Executor, tmp_path: Path) -> None:
        """Three pieces that each cost one worker, where one piece may cost two."""
        traces = [str(tmp_path / "1"), "", str(tmp_path / "2"), "", str(tmp_path / "3")]
        assert list(workers.map(deadly_once, traces)) == traces

    @pytest.mark.parametrize("workers", ["processes"], indirect=True)
    def test_a_worker_lost_while_others_start_is_a_loss_as_well(self, workers: Executor,
                                                                monkeypatch: pytest.MonkeyPatch) -> None:
        """A pool that closes its pipes says so in an OSError of its own making; the system's stay what they are."""
        submit = ProcessPoolExecutor.submit
        errors = [OSError("handle is closed"), OSError(11, "no more processes")]

        def failing(*asked: Any) -> Any:
            if asked[-1] == 3 and errors:
                raise errors.pop(0)
            return submit(*asked)

        monkeypatch.setattr(ProcessPoolExecutor, "submit", failing)
        with pytest.raises(OSError, match="no more processes"):
            list(workers.map(square, range(5)))
        assert list(workers.map(square, range(5))) == [0, 1, 4, 9, 16]

    @pytest.mark.parametrize("workers", ["processes", "dask"], indirect=True)
    def test_work_that_ends_every_worker_is_given_up(self, workers: Executor) -> None:
        """In one line, and the workers that are left go on with what comes then."""
        results = workers.map(deadly, range(5))
        with pytest.raises(HarnessError, match=r"piece 4 of 5.* ended 2 workers one after the other") as raised:
            list(results)
        assert "\n" not in str(raised.value)
        assert list(workers.map(square, range(2))) == [0, 1]

    @pytest.mark.parametrize("workers", ["dask"], indirect=True)
    def test_a_study_loses_nothing_with_a_worker(self, workers: Executor, tmp_path: Path) -> None:
        """A worker is killed when the third of twenty batches is there."""
        options = {"spp": 16, "replicas": 4, "max_replicas": 4, "tolerance": 0.5,
                   "reference": Estimate.exact(np.full((18, 24, 3), 0.5))}
        here = study(SPHERES, ["mixture"], store=Store(tmp_path / "here"), **options)  # type: ignore[arg-type]
        before = {number for number, _ in workers.map(process, range(8))}
        done = []

        class Killing:
            """The workers, one of which is killed in the middle."""

            def map(self, work, items):  # type: ignore[no-untyped-def]
                for result in workers.map(work, items):
                    done.append(result)
                    if len(done) == 3:
                        os.kill(max(before), signal.SIGKILL)
                    yield result

        there = study(SPHERES, ["mixture"], store=Store(tmp_path / "there"), executor=Killing(),
                      **options)  # type: ignore[arg-type]
        assert len(done) == 4 * 5
        assert max(before) not in {number for number, _ in workers.map(process, range(8))}
        ours, theirs = here.strategies[0].estimate, there.strategies[0].estimate
        np.testing.assert_array_equal(ours.mean, theirs.mean)
        np.testing.assert_array_equal(ours.variance, theirs.variance)


class TestProcesses:
    """Their environment."""

    def test_are_others_and_have_one_thread_each(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """And what was set in this one for them is gone afterwards."""
        for name in ONE_THREAD:
            monkeypatch.delenv(name, raising=False)
        with Processes(2) as workers:
            found = list(workers.map(process, range(4)))
        assert os.getpid() not in {number for number, _ in found}
        assert {threads for _, threads in found} == {"1"}
        assert not set(ONE_THREAD) & set(os.environ)

    def test_a_process_that_a_broken_pool_forgets_is_ended(self, monkeypatch: pytest.MonkeyPatch,
                                                           tmp_path: Path) -> None:
        """One that starts while the pool breaks is not ended by it, which then waits for it for ever."""
        monkeypatch.setattr(SpawnProcess, "terminate", lambda process: None)
        dismiss, forgets = _ExecutorManagerThread.shutdown_workers, [True]
        monkeypatch.setattr(_ExecutorManagerThread, "shutdown_workers",
                            lambda manager: None if forgets and forgets.pop() else dismiss(manager))
        traces = ["", str(tmp_path / "trace"), ""]
        found: list[str] = []

        def run() -> None:
            with executor("processes", 2) as opened:
                found.extend(opened.map(deadly_once, traces))

        running = threading.Thread(target=run, daemon=True)
        running.start()
        running.join(120)
        ended = not running.is_alive()
        for child in multiprocessing.active_children() if not ended else ():
            child.kill()
        assert ended and found == traces

    def test_what_the_user_set_wins(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
        with Processes(1) as workers:
            (_, threads), = workers.map(process, range(1))
        assert threads == "3"
        assert os.environ["OPENBLAS_NUM_THREADS"] == "3"


class TestDask:
    """What only it can lack."""

    def test_a_worker_with_several_threads_is_refused(self, monkeypatch: pytest.MonkeyPatch) -> None:
        from harness.work.executors.dask import _Work

        worker = SimpleNamespace(address="tcp://10.0.0.2:40000", state=SimpleNamespace(nthreads=4))
        monkeypatch.setattr("distributed.get_worker", lambda: worker)
        with pytest.raises(HarnessError, match=r"tcp://10\.0\.0\.2:40000 has 4 threads.*--nthreads 1"):
            _Work(square, None, "run")(3)

    @pytest.mark.parametrize("given", [{"scheduler": "tcp://127.0.0.1:9"}, {}])
    def test_a_scheduler_that_is_not_there_is_said(self, given: dict[str, str],
                                                   monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", "tcp://127.0.0.1:9")
        monkeypatch.setattr("harness.work.executors.dask.CONNECT_SECONDS", 0.1)
        with pytest.raises(HarnessError, match=r"tcp://127\.0\.0\.1:9: no "), executor("dask", 2, options=given):
            raise AssertionError("opened")


class TestSlurm:
    """Its jobs, as processes of this machine."""

    def test_a_job_that_ends_without_a_word_is_begun_again(self, tmp_path: Path,
                                                           monkeypatch: pytest.MonkeyPatch) -> None:
        import submitit

        monkeypatch.setattr(submitit.core.core.Job, "_results_timeout_s", 0)
        options = {"cluster": "local", "folder": str(tmp_path / "jobs"), "time": 5}
        tasks = list(tasks_of(Tracer(), SPHERES, range(1), 4))
        with executor("slurm", 1, options=options) as workers:
            draw(tasks, workers, Store(tmp_path / "there"))
            traces = [str(tmp_path / "trace"), "", ""]
            assert list(workers.map(deadly_once, traces)) == traces
            monkeypatch.setattr(base, "ALLOWED_LOSSES", 0)
            with pytest.raises(HarnessError, match=r"piece 4 of 5 ended 1 workers.*; see .*jobs"):
                list(workers.map(deadly, range(5)))
        assert list((tmp_path / "jobs").iterdir()) == [], "what jobs leave behind goes with the last of them"
        with executor("serial") as here:
            draw(tasks, here, Store(tmp_path / "here"))
        found = [sorted((path.name, read.mean.tobytes()) for _, _, path in store.files() if (read := store.read(path)))
                 for store in (Store(tmp_path / "here"), Store(tmp_path / "there"))]
        assert found[0] == found[1] and len(found[0]) == len(tasks)

    def test_a_job_whose_time_is_nearly_over_leaves_the_rest_to_another(self, tmp_path: Path,
                                                                        monkeypatch: pytest.MonkeyPatch) -> None:
        """It ends what it is doing: nothing is done twice."""
        import submitit

        monkeypatch.setattr(submitit.core.core.Job, "_results_timeout_s", 0)
        monkeypatch.setattr(base, "ALLOWED_LOSSES", 1)
        with executor("slurm", 1, options={"cluster": "local", "folder": str(tmp_path / "jobs"), "time": 5}) as workers:
            trace = str(tmp_path / "trace")
            assert list(workers.map(warned, [trace] * 5)) == [1, 2, 3, 4, 5]

    def test_work_is_shared_out_evenly(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """And so that the first results come from all jobs."""
        with executor("slurm", 3, options={"cluster": "debug"}) as workers:
            found = []
            honest = workers._submitted  # type: ignore[attr-defined]
            monkeypatch.setattr(workers, "_submitted", lambda work, shares, place: (
                found.extend(map(list, shares)), honest(work, shares, place))[1])
            assert list(workers.map(square, range(8))) == [number**2 for number in range(8)]
        assert found == [[0, 3, 6], [1, 4, 7], [2, 5]]

    def test_words_go_to_sbatch(self) -> None:
        from harness.work.executors.slurm import Slurm

        slurm = Slurm(1, options={"cluster": "local", "partition": "cpu", "time": 90, "mem_gb": 4})
        assert slurm._parameters() == {"timeout_min": 90, "slurm_partition": "cpu", "mem_gb": 4}

    @pytest.mark.parametrize(("options", "said"), [
        ({"cluster": "pbs"}, "cluster is 'pbs'; allowed: slurm, local, debug"),
        ({"cluster": "local", "partitoin": "cpu"}, "submitit refuses this: .*partitoin"),
    ])
    def test_a_word_that_is_none_is_refused(self, options: dict[str, str], said: str) -> None:
        with pytest.raises(HarnessError, match=said), executor("slurm", 2, options=options):
            raise AssertionError("opened")

    def test_without_accounts_the_queue_tells_what_became_of_jobs(self, tmp_path: Path,
                                                                  monkeypatch: pytest.MonkeyPatch) -> None:
        """With `sacct` that refuses, as Slurm's does where nobody set up a database, submitit would wait for ever."""
        import submitit

        from harness.work.executors.queue import Queue

        jobs = "7_0|RUNNING", "7_1|CANCELLED", "7_2|PENDING", "9|RUNNING"
        programs = {"sacct": "exit 1", "sbatch": "exit 1", "srun": "exit 1",
                    "squeue": f"test -e broken && exit 1; printf '%s\\n' {' '.join(map(repr, jobs))}"}
        for name, body in programs.items():
            (tmp_path / name).write_text(f"#!/bin/sh\n{body}\n")
            (tmp_path / name).chmod(0o755)
        monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(submitit.SlurmJob, "watcher", submitit.SlurmJob.watcher)
        with executor("slurm", options={"folder": str(tmp_path)}):
            queue = submitit.SlurmJob.watcher
            assert isinstance(queue, Queue)
        for job in ("7_0", "7_1", "7_2", "8_0"):
            queue.register_job(job)
        assert {job: queue.is_done(job, mode="force") for job in ("7_0", "7_1", "7_2", "8_0")} == {
            "7_0": False, "7_1": True, "7_2": False, "8_0": True}
        (tmp_path / "broken").touch()
        assert not queue.is_done("7_0", mode="force"), "a controller that is silent has ended no job"

    def test_no_slurm_here_is_said(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("PATH", "")
        with pytest.raises(MachineError, match="no `sbatch` on this machine"), executor("slurm"):
            raise AssertionError("opened")


class TestChoice:
    """The door."""

    def test_an_unknown_one_is_refused(self) -> None:
        with pytest.raises(HarnessError, match="unknown executor 'slurms'; choose from serial, processes, dask, slurm"):
            executor("slurms")

    @pytest.mark.parametrize("name", ["serial", "processes", "dask"])
    def test_an_unknown_option_is_refused(self, name: str) -> None:
        with pytest.raises(HarnessError, match=f"executor '{name}' knows no 'partition'; allowed: "):
            executor(name, options={"partition": "cpu"})

    @pytest.mark.parametrize(("name", "package", "extra"), [("dask", "distributed", "dask"),
                                                            ("slurm", "submitit", "slurm")])
    def test_a_missing_extra_is_said_with_its_line(self, name: str, package: str, extra: str,
                                                   monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(MachineError, match=rf"pip install 'glsl-validation-harness\[{extra}\]'"), executor(name):
            raise AssertionError("opened")
