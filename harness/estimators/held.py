"""Renderers that are opened when they are needed, one at a time."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from types import TracebackType

from harness.estimators.base import Estimator, Renderer
from harness.progress import Advance
from harness.samples.estimate import Batch
from harness.samples.traits import Traits
from harness.scene import SceneFile


class OneAtATime:
    """Opens renderers on demand, and closes each before it opens the next.

    drjit compiles every living scene into each other's kernels: 15 scenes held make one scene compile seven times as
    long (see `ReferenceRenderer.release`). What was drawn of each is its run's to keep.
    """

    def __init__(self) -> None:
        self._open: tuple[Estimator, SceneFile] | None = None
        self._renderer: Renderer | None = None
        self._stack = ExitStack()

    def __enter__(self) -> OneAtATime:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    def of(self, estimator: Estimator, scene: SceneFile) -> Renderer:
        """A renderer that may be used for as long as this lasts, whatever was opened in between."""
        return _OnDemand(self, estimator, scene)

    def opened(self, estimator: Estimator, scene: SceneFile) -> Renderer:
        """The renderer itself, the only one that is open."""
        if self._renderer is None or self._open != (estimator, scene):
            self.close()
            self._renderer = self._stack.enter_context(estimator.open(scene))
            self._open = estimator, scene
        return self._renderer

    def close(self) -> None:
        """Close what is open; it is opened again when it is needed."""
        self._open = self._renderer = None
        self._stack.close()


class _OnDemand:
    """What of a renderer outlives it: its identity and traits are asked once."""

    def __init__(self, held: OneAtATime, estimator: Estimator, scene: SceneFile) -> None:
        self._held, self._estimator, self.scene = held, estimator, scene
        renderer = held.opened(estimator, scene)
        self.identity: Mapping[str, str] = dict(renderer.identity)
        self.traits: Traits = renderer.traits

    def render_batch(self, replica: int, start: int, count: int, advance: Advance | None = None) -> Batch:
        return self._held.opened(self._estimator, self.scene).render_batch(replica, start, count, advance)
