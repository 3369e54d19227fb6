"""Batches of our tracer with a library, from the store where they are there: compiled only where one is not."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

from harness.estimators.base import Renderer
from harness.estimators.tracer import Tracer
from harness.gpu.context import describe_gl
from harness.samples.estimate import Batch
from harness.samples.keys import code_digest, digest
from harness.samples.store import Store
from harness.scene import Scene, SceneFile
from harness.shader.library import Library


class Drawn:
    """The batches of one picture, each a replica with `spp` samples per pixel, numbered from the replica `first`."""

    def __init__(self, scene: SceneFile, reading: Scene, strategy: str, library: Library, store: Store | None, spp: int,
                 first: int) -> None:
        self._scene, self._store, self._spp, self._first = scene, store, spp, first
        self._tracer = Tracer(strategy, library)
        self._key = {"renderer": "cause", "scene": reading.content_hash, "strategy": strategy,
                     "shader": digest(library.tracer(reading, strategy).text, 16),
                     "code": code_digest("harness.estimators.tracer"), **describe_gl()}
        self._held: dict[int, Batch] = {}

    def __enter__(self) -> Drawn:
        self._open = ExitStack()
        self._renderer: Renderer | None = None
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def batch(self, index: int) -> Batch:
        """One of them, from 0."""
        if index not in self._held:
            replica = self._first + index
            self._held[index] = self._draw(replica) if self._store is None else self._store.get_or_render(
                self._key, replica, 0, self._spp, lambda: self._draw(replica))
        return self._held[index]

    def batches(self, count: int) -> Iterator[Batch]:
        """The first so many."""
        return (self.batch(index) for index in range(count))

    def _draw(self, replica: int) -> Batch:
        if self._renderer is None:
            self._renderer = self._open.enter_context(self._tracer.open(self._scene))
        return self._renderer.render_batch(replica, 0, self._spp)
