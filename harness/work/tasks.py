"""Tasks: portions of samples that any process may draw, in any order, twice or not at all, through the store."""

from __future__ import annotations

import platform
from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

from harness.errors import HarnessError
from harness.estimators.base import Estimator, scene_name
from harness.estimators.held import OneAtATime
from harness.progress import Advance
from harness.samples.estimate import Batch
from harness.samples.store import Store, portions
from harness.scene import SceneFile
from harness.work.executors import Executor


@dataclass(frozen=True)
class Task:
    """One batch: samples start … start+count-1 per pixel of one replica of an estimator of a scene.

    `keep`: whether it is worth its room in the store once it has been read (see `samples.store.portions`).
    """

    estimator: Estimator
    scene: SceneFile
    replica: int
    start: int
    count: int
    keep: bool = True


def tasks_of(estimator: Estimator, scene: SceneFile, replicas: range, spp: int, *, prefixes: bool = True,
             repeats: bool = True) -> Iterator[Task]:
    """The batches of replicas of `spp` samples per pixel, as `work.batches` then reads them: `samples.store.portions`
    tells of `prefixes` and `repeats`."""
    return (Task(estimator, scene, replica, *portion)
            for replica in replicas for portion in portions(spp, prefixes=prefixes, repeats=repeats))


# Of this process: tasks of one estimator come one after the other, and compiling it takes as long as many samples.
_held = OneAtATime()


def draw(tasks: Iterable[Task], executor: Executor, store: Store, advance: Advance = lambda n: None, *,
         identity: Mapping[str, str] | None = None) -> None:
    """See that the store holds the batches of these tasks; `advance` is told the samples per pixel of each.

    The rest as `drawn`.
    """
    with closing(drawn(tasks, executor, store, identity=identity)) as done:
        for task in done:
            advance(task.count)


def drawn(tasks: Iterable[Task], executor: Executor, store: Store, *,
          identity: Mapping[str, str] | None = None) -> Generator[Task]:
    """The tasks in their order, each as soon as the store holds the batches of it and of all before it, for good or
    until `work.batches` has read them once.

    What it holds already is not drawn again, so a run that was interrupted goes on, and one that is done does nothing.
    `identity`: of the renderer as it is in this process, where it is known. HarnessError where a worker does not see
    the store, and where its renderer is another (another driver, another version): its batches would not be found.
    """
    asked = [replace(task, scene=replace(task.scene, path=task.scene.path.absolute())) for task in tasks]
    root = store.root.absolute()
    try:
        with store.mark() as mark:
            work = partial(_perform, root=root, limit=store.limit, mark=mark,
                           identity=None if identity is None else dict(identity))
            for task, _ in zip(asked, executor.map(work, asked), strict=True):
                yield task
    finally:
        _held.close()


@cache
def _store(root: Path, limit: int) -> Store:
    """One of each a process: a store knows its size from what it wrote."""
    return Store(root, limit)


def _perform(task: Task, root: Path, limit: int, mark: str, identity: Mapping[str, str] | None) -> None:
    """Draw one task, where the store does not hold it."""
    store = _store(root, limit)
    if not store.sees(mark):
        raise HarnessError(f"{root}: the worker on {platform.node()} does not see this folder, through which samples "
                           "come back; set HARNESS_CACHE to a folder that all machines share")
    renderer = _held.of(task.estimator, task.scene)
    if identity is not None and (other := _difference(renderer.identity, identity)):
        raise HarnessError(f"the worker on {platform.node()} draws other samples than this machine: {other}; give both "
                           "the same driver and packages, or start the command where the workers are")

    def render() -> Batch:
        return renderer.render_batch(task.replica, task.start, task.count)

    store.hold(renderer.identity, task.replica, task.start, task.count, render,
               keep=task.keep or not renderer.traits.repeats, scene=scene_name(renderer))


def _difference(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """The first entry in which two identities differ, in words; empty where they are one."""
    names = (name for name in sorted(there.keys() | here.keys()) if there.get(name) != here.get(name))
    return next((f"its {name} is '{there.get(name, '')}', here '{here.get(name, '')}'" for name in names), "")
