"""Tasks: whoever draws them, and however often, the store holds the same batches."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.estimators.tracer import Tracer
from harness.files import data_dir
from harness.samples.store import LEAD_FACTOR, LEAD_IN, Store, schedule
from harness.scene import SceneFile
from harness.shader.library import OURS
from harness.studies.study import study
from harness.work.batches import batches
from harness.work.executors import executor
from harness.work.tasks import Task, draw, tasks_of

SPHERES = SceneFile(data_dir("mitsuba_scenes") / "spheres.xml", size=(24, 18))
# Executors that start in a moment; those of clusters are held against this process in test_executors.
OWN = ("serial", "processes")


def files(root: Path) -> dict[str, bytes]:
    """The pixels of every batch of a store, by its name there."""
    from harness.samples.exr import read_batch

    return {str(path.relative_to(root)): read_batch(path).mean.tobytes() for path in sorted(root.rglob("*.exr"))}


def test_a_task_is_a_value() -> None:
    """It goes to another process, or into a set."""
    mutant = OURS.with_functions("course/lobe_pdf.glsl")
    task = Task(Tracer("mixture", mutant), SPHERES, 3, 0, 16)
    assert pickle.loads(pickle.dumps(task)) == task
    assert len({task, Task(Tracer("mixture", mutant), SPHERES, 3, 0, 16)}) == 1


def test_tasks_cover_replicas_in_the_schedule_of_the_store() -> None:
    tasks = list(tasks_of(Tracer(), SPHERES, range(2, 4), 10))
    assert [(task.replica, task.start, task.count) for task in tasks] == [
        (replica, start, count) for replica in (2, 3) for start, count in schedule(10)]


def test_what_nobody_looks_at_is_drawn_at_once() -> None:
    """Of long runs, which do not keep it; but all is kept of what would be another image."""
    spp = LEAD_FACTOR * LEAD_IN
    whole = [(task.start, task.count, task.keep) for task in tasks_of(Tracer(), SPHERES, range(1), spp, prefixes=False)]
    assert whole == [(0, LEAD_IN, False), *((start, count, True) for start, count in schedule(spp) if start >= LEAD_IN)]
    assert next(tasks_of(Tracer(), SPHERES, range(1), spp - 1, prefixes=False)).count == 1
    assert all(task.keep for task in tasks_of(Tracer(), SPHERES, range(1), spp, prefixes=False, repeats=False))


def test_executors_leave_the_same_pixels(tmp_path: Path) -> None:
    tasks = [*tasks_of(Tracer("mixture"), SPHERES, range(2), 8), *tasks_of(Tracer("uniform"), SPHERES, range(1), 8)]
    found = []
    for name in OWN:
        told: list[float] = []
        with executor(name, 2) as workers:
            draw(tasks, workers, Store(tmp_path / name), told.append)
        assert sum(told) == 24
        found.append(files(tmp_path / name))
    assert len(found[0]) == len(tasks)
    assert all(other == found[0] for other in found)


@pytest.mark.parametrize("name", OWN)
def test_long_runs_leave_the_same_files_whoever_drew_them(tmp_path: Path, name: str) -> None:
    """What is not worth its room goes when it has been read."""
    tiny, replicas, spp = SPHERES.sized(12, 9), range(2), LEAD_FACTOR * LEAD_IN
    here, there = Store(tmp_path / "here"), Store(tmp_path / name)
    with executor(name, 2) as workers:
        draw(tasks_of(Tracer(), tiny, replicas, spp), workers, there)
    handed_over = {path.name for path in there.root.rglob("*.once.exr")}
    assert handed_over == {f"{replica}-{start}-{count}.once.exr" for replica in replicas
                           for start, count in schedule(LEAD_IN)}
    with Tracer().open(tiny) as renderer:
        alone = [batch.mean for replica in replicas for batch in batches(renderer, spp, replica=replica, store=here)]
        honest, drawn = renderer.render_batch, []
        renderer.render_batch = lambda *batch: (drawn.append(batch), honest(*batch))[1]  # type: ignore[method-assign]
        read = [batch.mean for replica in replicas for batch in batches(renderer, spp, replica=replica, store=there)]
    assert drawn == []
    np.testing.assert_array_equal(read, alone)
    assert files(there.root) == files(here.root)
    assert len(files(here.root)) == 2 * 3


def test_what_is_there_is_not_drawn_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An interrupted run goes on where it was."""
    tasks = list(tasks_of(Tracer("mixture"), SPHERES, range(2), 8))
    with executor("serial") as workers:
        draw(tasks[:5], workers, Store(tmp_path))
        calls: list[int] = []
        from harness.gpu.renderer import TracerRenderer
        honest = TracerRenderer.render_batch
        monkeypatch.setattr(TracerRenderer, "render_batch",
                            lambda self, *arguments: (calls.append(1), honest(self, *arguments))[1])
        draw(tasks, workers, Store(tmp_path))
    assert len(calls) == len(tasks) - 5


def test_a_study_is_the_same_in_processes(tmp_path: Path) -> None:
    """With replicas that have curves, and long ones that are drawn to decide alone."""
    small = SPHERES.sized(24, 18)
    options = {"spp": LEAD_FACTOR * LEAD_IN, "replicas": 2, "max_replicas": 4, "reference_spp": 256, "tolerance": 0.004}
    here = study(small, ["mixture", "cosine"], store=Store(tmp_path / "here"), **options)  # type: ignore[arg-type]
    with executor("processes", 2) as workers:
        there = study(small, ["mixture", "cosine"], store=Store(tmp_path / "there"), executor=workers,
                      **options)  # type: ignore[arg-type]
    for ours, theirs in zip(here.strategies, there.strategies, strict=True):
        assert ours.estimate.samples == 4 * LEAD_FACTOR * LEAD_IN
        np.testing.assert_array_equal(ours.estimate.mean, theirs.estimate.mean)
    assert not list((tmp_path / "there").rglob("*.once.exr")), "handed over and never read"


def test_a_study_hands_over_through_a_store_alone() -> None:
    with executor("serial") as workers, pytest.raises(HarnessError, match="through a store; give the study one"):
        study(SPHERES, ["mixture"], executor=workers)


class TestWorkers:
    """Of other machines, which may lack what this one has."""

    TASKS = (Task(Tracer("mixture"), SPHERES, 0, 0, 1),)

    def test_one_that_does_not_see_the_store_is_said(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Its disk is another, though its path is the same."""
        monkeypatch.setattr(Store, "sees", lambda self, mark: (tmp_path / "elsewhere" / mark).exists())
        said = r"does not see this folder.*set HARNESS_CACHE"
        with executor("serial") as workers, pytest.raises(HarnessError, match=said):
            draw(self.TASKS, workers, Store(tmp_path / "store"))

    def test_one_that_draws_other_samples_is_said(self, tmp_path: Path) -> None:
        with Tracer("mixture").open(SPHERES) as renderer:
            identity = dict(renderer.identity)
        for there, said in (({**identity, "gl_version": "4.5 Mesa 99"}, "its gl_version is '.*', here '4.5 Mesa 99'"),
                            ({**identity, "sampler": "sobol"}, "its sampler is '', here 'sobol'")):
            with executor("serial") as workers, pytest.raises(HarnessError, match=said):
                draw(self.TASKS, workers, Store(tmp_path), identity=there)
        with executor("serial") as workers:
            draw(self.TASKS, workers, Store(tmp_path), identity=identity)

    def test_no_mark_is_left_behind(self, tmp_path: Path) -> None:
        with executor("serial") as workers:
            draw(self.TASKS, workers, Store(tmp_path))
        assert [path.name for path in tmp_path.iterdir() if path.is_file()] == []

    def test_paths_are_whole(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """A worker's folder is another."""
        (tmp_path / "spheres.xml").symlink_to(SPHERES.path)
        (tmp_path / "worker").mkdir()
        monkeypatch.chdir(tmp_path)
        asked = []

        class Elsewhere:
            def map(self, work, items):  # type: ignore[no-untyped-def]
                asked.extend(items)
                monkeypatch.chdir("worker")
                return map(work, asked)

        relative = Task(Tracer("mixture"), SceneFile(Path("spheres.xml"), size=(24, 18)), 0, 0, 1)
        draw([relative], Elsewhere(), Store("store"))
        assert [task.scene.path for task in asked] == [tmp_path / "spheres.xml"]
        assert len(list(tmp_path.glob("store/*/*/*.exr"))) == 1
