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
from harness.work.executors import EXECUTORS, executor
from harness.work.tasks import Task, draw, tasks_of

SPHERES = SceneFile(data_dir("mitsuba_scenes") / "spheres.xml", size=(24, 18))


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


def test_every_executor_leaves_the_same_pixels(tmp_path: Path) -> None:
    tasks = [*tasks_of(Tracer("mixture"), SPHERES, range(2), 8), *tasks_of(Tracer("uniform"), SPHERES, range(1), 8)]
    found = []
    for name in EXECUTORS:
        told: list[float] = []
        with executor(name, 2) as workers:
            draw(tasks, workers, Store(tmp_path / name), told.append)
        assert sum(told) == 24
        found.append(files(tmp_path / name))
    assert len(found[0]) == len(tasks)
    assert all(other == found[0] for other in found)


@pytest.mark.parametrize("name", EXECUTORS)
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
    options = {"spp": 8, "replicas": 2, "max_replicas": 2, "reference_spp": 32, "tolerance": 0.5}
    here = study(SPHERES, ["mixture", "cosine"], store=Store(tmp_path / "here"), **options)  # type: ignore[arg-type]
    with executor("processes", 2) as workers:
        there = study(SPHERES, ["mixture", "cosine"], store=Store(tmp_path / "there"), executor=workers,
                      **options)  # type: ignore[arg-type]
    for ours, theirs in zip(here.strategies, there.strategies, strict=True):
        np.testing.assert_array_equal(ours.estimate.mean, theirs.estimate.mean)


def test_a_study_hands_over_through_a_store_alone() -> None:
    with executor("serial") as workers, pytest.raises(HarnessError, match="through a store; give the study one"):
        study(SPHERES, ["mixture"], executor=workers)
