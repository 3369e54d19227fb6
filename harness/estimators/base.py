"""What an estimator is: a description of what is judged or held against, and the renderer that it opens on a scene.

To add an estimator, write a frozen dataclass with `name` and `open` into a file of its own in this room. Whatever its
renderer holds (a GL program, a Mitsuba scene, a process) is let go of where the `with` ends.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Protocol, runtime_checkable

from harness.progress import Advance
from harness.samples.estimate import Batch
from harness.samples.traits import Traits
from harness.scene.file import SceneFile


class Named(Protocol):
    """A scene, or the file of one."""

    @property
    def name(self) -> str:
        """What people call it."""
        ...


class Renderer(Protocol):
    """What renders batches of one scene; live only inside the `with` that opened it."""

    @property
    def identity(self) -> Mapping[str, str]:
        """All that a batch depends on besides replica and sample range; a flat mapping, hashed by the store."""
        ...

    @property
    def traits(self) -> Traits:
        """What can be asked of it."""
        ...

    def render_batch(self, replica: int, start: int, count: int, advance: Advance | None = None) -> Batch:
        """Samples start … start+count-1 per pixel of one replica. HarnessError for a range that it has not."""
        ...


@runtime_checkable
class OfScene(Protocol):
    """A renderer that says of what; one of a stranger's shader knows no scene."""

    @property
    def scene(self) -> Named:
        """What it renders."""
        ...


def scene_name(renderer: Renderer) -> str:
    """The name of the scene that a renderer renders, for people who look into the store; empty where it has none."""
    return renderer.scene.name if isinstance(renderer, OfScene) else ""


class Estimator(Protocol):
    """A description of what is judged, or of what it is held against: frozen, hashable, picklable."""

    @property
    def name(self) -> str:
        """What tables and messages call it: `mixture`, `mitsuba path`, `myrt`, …"""
        ...

    def check(self, scene: SceneFile) -> str:
        """Why its image of the scene must differ from the truth, in a sentence; empty where nothing is known of that.

        HarnessError for a name that is none, SceneError for a scene that it does not understand.
        """
        ...

    def open(self, scene: SceneFile) -> AbstractContextManager[Renderer]:
        """The renderer of this estimator on a scene. HarnessError where it cannot render the scene."""
        ...


@runtime_checkable
class TakesDepth(Protocol):
    """An estimator that may be asked for paths of another length than the scene's: `SceneFile.max_depth` reaches it."""

    def takes_depth(self, scene: SceneFile) -> str:
        """Why it cannot be asked after all, as what a message goes on with; empty where it can."""
        ...


@runtime_checkable
class TakesValues(Protocol):
    """An estimator that has named values of its own: those of `SceneFile.values` reach it."""

    def takes(self, scene: SceneFile) -> tuple[str, ...]:
        """Their names. Errors as `Estimator.check`."""
        ...


def taken(estimator: Estimator, scene: SceneFile) -> tuple[str, ...]:
    """The names of an estimator's own values; none where it has none."""
    return estimator.takes(scene) if isinstance(estimator, TakesValues) else ()


def no_depth(estimator: Estimator, scene: SceneFile) -> str:
    """Why an estimator cannot be asked for paths of another length; empty where it can."""
    if isinstance(estimator, TakesDepth):
        return estimator.takes_depth(scene)
    return f"{estimator.name} is what it is at every max_depth"
