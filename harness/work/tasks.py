"""Tasks: portions of samples that any process may draw, in any order, twice or not at all, through the store."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from harness.estimators.base import Estimator
from harness.estimators.held import OneAtATime
from harness.progress import Advance
from harness.samples.estimate import Batch
from harness.samples.store import Store, is_kept, schedule
from harness.scene import SceneFile
from harness.work.executors import Executor


@dataclass(frozen=True)
class Task:
    """One batch: samples start … start+count-1 per pixel of one replica of an estimator of a scene.

    `keep`: whether it is worth its room in the store once it has been read (see `samples.store.is_kept`).
    """

    estimator: Estimator
    scene: SceneFile
    replica: int
    start: int
    count: int
    keep: bool = True


def tasks_of(estimator: Estimator, scene: SceneFile, replicas: range, spp: int) -> Iterator[Task]:
    """The batches of replicas of `spp` samples per pixel, in the store's schedule."""
    return (Task(estimator, scene, replica, start, count, is_kept(start, count, spp))
            for replica in replicas for start, count in schedule(spp))


# Of this process: tasks of one estimator come one after the other, and compiling it takes as long as many samples.
_held = OneAtATime()


def draw(tasks: Iterable[Task], executor: Executor, store: Store, advance: Advance = lambda n: None) -> None:
    """See that the store holds the batches of these tasks, for good or until `work.batches` has read them once;
    `advance` is told the samples per pixel of each.

    What it holds already is not drawn again, so a run that was interrupted goes on, and one that is done does nothing.
    """
    try:
        for count in executor.map(partial(_perform, root=store.root, limit=store.limit), tasks):
            advance(count)
    finally:
        _held.close()


def _perform(task: Task, root: Path, limit: int) -> int:
    """Draw one task; returns its samples per pixel."""
    renderer = _held.of(task.estimator, task.scene)

    def render() -> Batch:
        return renderer.render_batch(task.replica, task.start, task.count)

    Store(root, limit).hold(renderer.identity, task.replica, task.start, task.count, render,
                            keep=task.keep or not renderer.traits.repeats)
    return task.count
