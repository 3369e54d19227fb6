"""The handout's pictures at full size: long renders that can be watched, interrupted and continued."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.errors import StoreError
from harness.estimators.tracer import Tracer
from harness.files import require_writable
from harness.progress import Progress, quiet
from harness.samples.estimate import Batch
from harness.samples.exr import read_estimate, write_batch
from harness.samples.images import write_png
from harness.samples.keys import digest
from harness.scene import Scene, file_of

# Seconds between two states of a picture on disk: what an interruption may cost, and how old the picture is at most.
SAVE_SECONDS = 20.0
# Samples per pixel rendered at once: seconds of work at 1024², so that Ctrl-C and the progress bar stay alive.
STEP = 32


@dataclass(frozen=True)
class Figure:
    """A figure of the handout: the scene file's name, and how many samples per pixel the handout gave it."""

    scene: str
    spp: int


# The course's handout shows both at 1024 x 1024.
SIDE = 1024
FIGURES = (Figure("displaced_spheres", 2_000), Figure("course_scene", 20_000))


@dataclass(frozen=True)
class Picture:
    """A picture as far as it is rendered.

    `samples` are per pixel, `resumed` of them were there when the call began; `rejected` counts, over the whole image,
    those that were not finite and so left out.
    """

    png: Path
    exr: Path
    samples: int
    resumed: int
    rejected: int


def render_picture(scene: Scene, spp: int, folder: Path, *, strategy: str = "mixture", progress: Progress = quiet,
                   saved: Callable[[Picture], None] = lambda picture: None) -> Picture:
    """Render `spp` samples per pixel of `scene` into `folder` as NAME.exr (linear) and NAME.png (as displayed).

    Both files are there from the first seconds on and are replaced every 20 seconds, and when the render is
    interrupted; `saved` is told each time. The same call then continues from the EXR file: samples are numbered, so
    what is there is never rendered twice. A finished picture of more samples stays as it is.

    StoreError where a file cannot be written, or where NAME.exr is not a state of this very picture.
    """
    exr, png = folder / f"{scene.name}.exr", folder / f"{scene.name}.png"
    for path in (exr, png):
        require_writable(path)
    file = file_of(scene)
    with Tracer(strategy).open(file) as renderer:
        state = _State(scene, exr, png, digest(dict(renderer.identity), 16), file.film.exposure)
        resumed = written = state.samples

        def picture() -> Picture:
            return Picture(png, exr, state.samples, resumed, state.rejected)

        began = time.monotonic()
        with progress(spp, f"{scene.name} {scene.width} x {scene.height}") as advance:
            advance(min(resumed, spp))
            try:
                while state.samples < spp:
                    count = min(max(state.samples, 1), STEP, spp - state.samples)
                    state.add(renderer.render_batch(0, state.samples, count))
                    advance(count)
                    if written == resumed or time.monotonic() - began > SAVE_SECONDS:
                        written = state.save()
                        saved(picture())
                        began = time.monotonic()
            finally:
                if written < state.samples:
                    state.save()
        if not png.exists():
            state.save()
        return picture()


class _State:
    """The sum of a picture's samples, as it is in memory and as it was last on disk."""

    def __init__(self, scene: Scene, exr: Path, png: Path, picture: str, exposure: float) -> None:
        self._scene, self._exr, self._png, self._picture, self._exposure = scene, exr, png, picture, exposure
        self._total = np.zeros((scene.height, scene.width, 3))
        self.rejected = 0
        self.samples = 0
        if exr.exists():
            self._read()

    def _read(self) -> None:
        found, facts = read_estimate(self._exr)
        if facts.get("picture") != self._picture:
            raise StoreError(f"{self._exr}: another picture (another scene, size, shader, code or driver); move it "
                             "away, or render into another folder")
        self._total = found.mean * found.samples
        self.samples = found.samples
        self.rejected = int(facts["not_finite"])

    def add(self, batch: Batch) -> None:
        self._total += batch.mean.astype(np.float64) * batch.samples
        self.rejected += batch.rejected
        self.samples += batch.samples

    def save(self) -> int:
        """Write both files; the samples that they hold."""
        mean = self._total / self.samples
        write_batch(self._exr, Batch(mean.astype(np.float32), self.samples), {
            "picture": self._picture, "scene": self._scene.name, "spp": self.samples, "not_finite": self.rejected})
        write_png(self._png, mean, self._exposure)
        return self.samples
