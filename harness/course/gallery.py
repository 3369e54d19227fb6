"""The handout's pictures at full size: long renders that can be watched, interrupted, continued and shared out."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.errors import StoreError
from harness.estimators.base import Renderer
from harness.estimators.tracer import Tracer
from harness.files import require_writable
from harness.progress import Advance, Progress, quiet
from harness.samples.cost import Cost
from harness.samples.estimate import Batch, Estimate
from harness.samples.exr import Value, read_estimate, write_batch
from harness.samples.images import write_png
from harness.samples.keys import digest
from harness.samples.store import Store, schedule
from harness.scene import Scene, SceneFile, file_of
from harness.work.batches import batches
from harness.work.executors import Executor
from harness.work.tasks import drawn, tasks_of

# Seconds between two states of a picture on disk: how old what one looks at is at the least.
SAVE_SECONDS = 20.0


@dataclass(frozen=True)
class Figure:
    """A figure of the handout: the scene file's name, and how many samples per pixel the handout gave it."""

    scene: str
    spp: int


# The course's handout shows both at 1024 x 1024.
SIDE = 1024
FIGURES = (Figure("displaced_spheres", 2_000), Figure("course_scene", 20_000))
STRATEGY = "mixture"


@dataclass(frozen=True)
class Picture:
    """A picture as far as it is rendered.

    `samples` are per pixel, `resumed` of them were there when the call began; `rejected` counts, over the whole image,
    those that were not finite and so left out. `seconds` by the clock that counts on `device`, of all workers together;
    NaN where there were several devices.
    """

    png: Path
    exr: Path
    samples: int
    resumed: int
    rejected: int
    seconds: float
    device: str


def render_picture(scene: Scene, spp: int, folder: Path, *, store: Store, strategy: str = STRATEGY,
                   executor: Executor | None = None, progress: Progress = quiet,
                   saved: Callable[[Picture], None] = lambda picture: None) -> Picture:
    """Render `spp` samples per pixel of `scene` into `folder` as NAME.exr (linear) and NAME.png (as displayed).

    The samples come through the store, as those of any run: what it holds is never rendered twice, whoever drew it, so
    an interrupted render goes on where it was. `executor`: where batches are drawn, here where None. Both files are
    there from the first samples on, are replaced as batches come in, and when the render is interrupted; `saved` is
    told each time. A finished picture of as many samples or more stays as it is.

    StoreError where a file cannot be written, or where NAME.exr is not a state of this very picture.
    """
    exr, png = folder / f"{scene.name}.exr", folder / f"{scene.name}.png"
    for path in (exr, png):
        require_writable(path)
    file, estimator = file_of(scene), Tracer(strategy)
    with estimator.open(file) as renderer:
        identity = dict(renderer.identity)
        shown = _Shown(exr, png, scene.name, digest(identity, 16), file.film.exposure)
        if shown.written >= spp:
            return shown.finished()
        shown.resumed = sum(count for start, count in schedule(spp) if store.has(identity, 0, start, count))
        with (progress(spp, f"{scene.name} {scene.width} x {scene.height}") as advance,
              closing(_drawn(estimator, file, renderer, spp, store, executor, advance)) as drawing):
            try:
                for batch in drawing:
                    shown.add(batch)
                    if shown.is_due():
                        saved(shown.save())
            finally:
                shown.save()
    return shown.picture()


def _drawn(estimator: Tracer, file: SceneFile, renderer: Renderer, spp: int, store: Store, executor: Executor | None,
           advance: Advance) -> Generator[Batch]:
    """The picture's batches in their order, each as soon as it is there."""
    if executor is None:
        yield from batches(renderer, spp, store=store, advance=advance)
        return
    with closing(drawn(tasks_of(estimator, file, range(1), spp), executor, store,
                       identity=renderer.identity)) as tasks:
        for task, batch in zip(tasks, batches(renderer, spp, store=store), strict=True):  # the task comes first
            advance(task.count)
            yield batch


class _Shown:
    """The sum of a picture's samples, and what of it is on disk. `written`: samples of the state there."""

    def __init__(self, exr: Path, png: Path, scene: str, picture: str, exposure: float) -> None:
        self._exr, self._png, self._scene, self._picture, self._exposure = exr, png, scene, picture, exposure
        self._total: np.ndarray | float = 0.0
        self._saved_at = -math.inf
        self._cost: Cost | None = None
        self.samples = self.rejected = self.resumed = self.written = 0
        if exr.exists():
            found, facts = self._state()
            self.written = found.samples
            self._finished = Picture(png, exr, found.samples, found.samples, int(facts["not_finite"]),
                                     float(facts["seconds"]), str(facts["device"]))

    def _state(self) -> tuple[Estimate, dict[str, Value]]:
        found, facts = read_estimate(self._exr)
        if facts.get("picture") != self._picture:
            raise StoreError(f"{self._exr}: another picture (another scene, size, shader, code or driver); move it "
                             "away, or render into another folder")
        return found, facts

    def finished(self) -> Picture:
        """What is on disk, its PNG made again where it is lost."""
        if not self._png.exists():
            write_png(self._png, self._state()[0].mean, self._exposure)
        return self._finished

    def add(self, batch: Batch) -> None:
        """Of one more batch."""
        self._total = self._total + batch.mean.astype(np.float64) * batch.samples
        self.rejected += batch.rejected
        self.samples += batch.samples
        self._cost = batch.cost if self._cost is None else self._cost + batch.cost

    def is_due(self) -> bool:
        """Whether there is more to be seen than on disk, and what is there is old."""
        return self.samples > self.written and time.monotonic() - self._saved_at > SAVE_SECONDS

    def save(self) -> Picture:
        """Write both files, if there is more to be seen."""
        if self.samples > self.written:
            mean = np.asarray(self._total / self.samples)
            write_batch(self._exr, Batch(mean.astype(np.float32), self.samples), {
                "picture": self._picture, "scene": self._scene, "spp": self.samples, "not_finite": self.rejected,
                "seconds": self.picture().seconds, "device": self.picture().device})
            write_png(self._png, mean, self._exposure)
            self.written, self._saved_at = self.samples, time.monotonic()
        return self.picture()

    def picture(self) -> Picture:
        """As far as it is rendered."""
        cost = self._cost or Cost.unknown()
        return Picture(self._png, self._exr, self.samples, min(self.resumed, self.samples), self.rejected, cost.seconds,
                       cost.device)
