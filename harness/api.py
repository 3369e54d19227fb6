"""The public verbs: an image of a scene by the tracer, and one by Mitsuba."""

from __future__ import annotations

from harness.gpu.renderer import TracerRenderer
from harness.progress import Progress, quiet
from harness.reference.renderer import ReferenceRenderer
from harness.samples.estimate import Estimate
from harness.samples.store import Store
from harness.scene import Scene
from harness.work.batches import render_estimate


def render(scene: Scene, strategy: str = "mixture", spp: int = 256, *, replica: int = 0, store: Store | None = None,
           progress: Progress = quiet) -> Estimate:
    """The tracer's image of the scene with `spp` samples per pixel. HarnessError for an unknown strategy."""
    renderer = TracerRenderer(scene, strategy)
    try:
        with progress(spp, f"{scene.name} {strategy}") as advance:
            return render_estimate(renderer, spp, replica=replica, store=store, advance=advance)
    finally:
        renderer.release()


def render_reference(scene: Scene, spp: int, *, store: Store | None = None, progress: Progress = quiet) -> Estimate:
    """Mitsuba's image of the scene with `spp` samples per pixel."""
    renderer = ReferenceRenderer(scene)
    with progress(spp, f"{scene.name} reference") as advance:
        return render_estimate(renderer, spp, store=store, advance=advance)
