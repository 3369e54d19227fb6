"""An estimator opened in a process of its own: for what a process is only once, such as how wide its vectors are."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from harness.estimators.base import Estimator, Renderer
from harness.samples.estimate import Batch
from harness.scene import SceneFile
from harness.work.executors.base import Prepare
from harness.work.executors.processes import begin


@dataclass(frozen=True)
class Apart:
    """`estimator`, in a process that has done `prepare` before anything else. Both are picklable."""

    estimator: Estimator
    prepare: Prepare

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[ApartRenderer]:
        """Raises what the estimator raises."""
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), begin, (self.prepare,)) as process:
            process.submit(_open, self.estimator, scene).result()
            try:
                yield ApartRenderer(process)
            finally:
                process.submit(_close).result()


class ApartRenderer:
    """Draws batches there. Their costs are that process's own."""

    def __init__(self, process: ProcessPoolExecutor) -> None:
        self._process = process

    def render_batch(self, replica: int, start: int, count: int,
                     advance: Callable[[float], None] | None = None) -> Batch:
        """See `Renderer.render_batch`; `advance` is told of all at once."""
        drawn: Future[Batch] = self._process.submit(_draw, replica, start, count)
        batch = drawn.result()
        if advance:
            advance(count)
        return batch


class _There:
    """Of the process apart: its renderer, and what closes it."""

    renderer: Renderer
    opened = ExitStack()


def _open(estimator: Estimator, scene: SceneFile) -> None:
    _There.renderer = _There.opened.enter_context(estimator.open(scene))


def _draw(replica: int, start: int, count: int) -> Batch:
    return _There.renderer.render_batch(replica, start, count)


def _close() -> None:
    _There.opened.close()
