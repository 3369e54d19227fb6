"""The public verbs: an image of a scene by the tracer, and one by Mitsuba."""

from __future__ import annotations

from pathlib import Path

from harness.estimators.base import Estimator
from harness.estimators.mitsuba import Mitsuba
from harness.estimators.tracer import Tracer
from harness.progress import Progress, quiet
from harness.samples.estimate import Estimate
from harness.samples.store import Store
from harness.scene import Scene, SceneFile, file_of
from harness.work.batches import render_estimate


def scene_file(scene: Scene | SceneFile | str | Path) -> SceneFile:
    """A scene file however it is named: by its path, or by our reading of it."""
    if isinstance(scene, SceneFile):
        return scene
    return file_of(scene) if isinstance(scene, Scene) else SceneFile(Path(scene))


def estimate(estimator: Estimator, scene: Scene | SceneFile | str | Path, spp: int, *, replica: int = 0,
             store: Store | None = None, progress: Progress = quiet) -> Estimate:
    """An estimator's image of the scene: mean and variance of `spp` samples per pixel of one replica.

    HarnessError where the estimator cannot render the scene.
    """
    file = scene_file(scene)
    with estimator.open(file) as renderer, progress(spp, f"{file.name} {estimator.name}") as advance:
        return render_estimate(renderer, spp, replica=replica, store=store, advance=advance)


def render(scene: Scene | SceneFile | str | Path, strategy: str = "mixture", spp: int = 256, *, replica: int = 0,
           store: Store | None = None, progress: Progress = quiet) -> Estimate:
    """The tracer's image of the scene with `spp` samples per pixel. HarnessError for an unknown strategy."""
    return estimate(Tracer(strategy), scene, spp, replica=replica, store=store, progress=progress)


def render_reference(scene: Scene | SceneFile | str | Path, spp: int, *, store: Store | None = None,
                     progress: Progress = quiet) -> Estimate:
    """Mitsuba's image of the scene with `spp` samples per pixel."""
    return estimate(Mitsuba(), scene, spp, store=store, progress=progress)
