"""What is watched: an image that grows batch by batch, and what each key changes. Knows nothing of windows."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.estimators.base import Estimator, Renderer, no_depth
from harness.estimators.held import OneAtATime
from harness.metrics import mean_error, rmse
from harness.samples.estimate import Accumulator, Estimate
from harness.samples.exr import write_estimate
from harness.samples.images import write_png
from harness.scene.file import MAX_DEPTH_LIMIT, SceneFile
from harness.stats.channels import Channel

# What the keys do, as `harness view --help` and the first line on stderr say it.
HELP = ("left, right: strategy; up, down: exposure; page up, page down: depth; space: pause; R: start again; S: save; "
        "Q, Esc: leave")
EXPOSURE_STEP = 0.5  # stops
# A batch is twice as long as the one before while that takes less time: keys are answered after each.
BATCH_SECONDS, LONGEST = 0.1, 64
# Samples of a replica, after which the next one goes on: strangers' shaders have no more (harness.estimators.shader).
REPLICA = 1024

FindReference = Callable[[SceneFile], Estimate | None]


@dataclass(frozen=True)
class Watched:
    """What is chosen: the number of the estimator, the exposure in stops, and the depth, None for the scene's own."""

    number: int = 0
    exposure: float = 0.0
    depth: int | None = None


class Session:
    """A scene seen through one of several estimators. To be used in a `with`, which closes the renderer.

    `find_reference`: what a scene's image is held against, where there is anything; `folder`: where images are saved;
    `name`: what the title calls it, the scene's if None; `facts`: metadata of saved images. Samples are those of
    replica 0 from the first on, so the image is, but for rounding, the one that `harness render` has of as many.
    """

    def __init__(self, scene: SceneFile, estimators: Sequence[Estimator], chosen: Watched = Watched(), *,
                 find_reference: FindReference = lambda scene: None, folder: Path = Path(), name: str | None = None,
                 facts: Mapping[str, Any] | None = None) -> None:
        self._scene, self._estimators, self.chosen = scene, tuple(estimators), chosen
        self._name = scene.name if name is None else name
        self._find, self._folder, self._facts = find_reference, folder, dict(facts or {})
        self._held = OneAtATime()
        self._references: dict[SceneFile, Estimate | None] = {}
        self.paused = self.done = False
        self.message = ""
        self.saved: list[Path] = []
        self._sum, self._count = Accumulator(), 1

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *raised: object) -> None:
        self._held.close()

    @property
    def estimator(self) -> Estimator:
        """The one that is drawn."""
        return self._estimators[self.chosen.number]

    @property
    def scene(self) -> SceneFile:
        """At the depth that is chosen."""
        return self._scene if self.chosen.depth is None else self._scene.at_depth(self.chosen.depth)

    @property
    def samples(self) -> int:
        """Samples per pixel so far."""
        return self._sum.samples

    @property
    def image(self) -> np.ndarray:
        """The mean so far, (H, W, 3) float64, row 0 at the top; black before the first sample."""
        film = self._scene.film
        return self._sum.mean if self._sum.batches else np.zeros((film.height, film.width, 3))

    @property
    def reference(self) -> Estimate | None:
        """What the image is held against."""
        if self.scene not in self._references:
            self._references[self.scene] = self._find(self.scene)
        return self._references[self.scene]

    @property
    def errors(self) -> dict[str, float]:
        """The mean's signed relative error in luminance, and the RMSE less the reference's noise; nothing where there
        is no reference."""
        reference = self.reference
        if reference is None or not self.samples:
            return {}
        noise = None if np.isnan(reference.variance).any() else reference.variance
        return {"mean_error": float(mean_error(self.image, reference.mean)[Channel.LUMINANCE]),
                "rmse": rmse(self.image, reference.mean, noise)}

    @property
    def title(self) -> str:
        """What the window's title says."""
        words = [self._name, self.estimator.name] if self._name else [self.estimator.name]
        if self.chosen.depth is not None:
            words.append(f"depth {self.chosen.depth}")
        words.append(f"{self.samples} spp")
        if self.chosen.exposure:
            words.append(f"{self.chosen.exposure:+g} stops")
        if found := self.errors:
            words.append(f"mean {found['mean_error']:+.2%}, RMSE {found['rmse']:.3g}")
        else:
            words.append("no reference")
        if self.paused:
            words.append("paused")
        return " | ".join([*words, self.message] if self.message else words)

    def advance(self) -> None:
        """Draw one more batch, unless it is paused. HarnessError as the estimator says."""
        if self.paused or self.done:
            return
        replica, start = divmod(self.samples, REPLICA)
        count = min(self._count, REPLICA - start)
        began = time.perf_counter()
        self._sum.add(self._renderer().render_batch(replica, start, count))
        if time.perf_counter() - began < BATCH_SECONDS:
            self._count = min(2 * self._count, LONGEST)

    def press(self, key: str) -> None:
        """Do what a key asks for; one that means nothing does nothing."""
        self.message = ""
        match key:
            case "left" | "right" if len(self._estimators) > 1:
                step = 1 if key == "right" else -1
                self._choose(replace(self.chosen, number=(self.chosen.number + step) % len(self._estimators)))
            case "up" | "down":
                brighter = EXPOSURE_STEP if key == "up" else -EXPOSURE_STEP
                self.chosen = replace(self.chosen, exposure=self.chosen.exposure + brighter)
            case "page up" | "page down":
                self._deepen(1 if key == "page up" else -1)
            case "space":
                self.paused = not self.paused
            case "r":
                self._restart()
            case "s":
                self._save()
            case "q" | "escape":
                self.done = True

    def _renderer(self) -> Renderer:
        return self._held.opened(self.estimator, self.scene)

    def _restart(self) -> None:
        self._sum, self._count = Accumulator(), 1

    def _choose(self, chosen: Watched) -> None:
        self.chosen = chosen
        self._restart()

    def _deepen(self, step: int) -> None:
        """Another depth, counted from the scene's own; refused in the title where the estimator knows none."""
        if reason := no_depth(self.estimator, self._scene):
            self.message = reason
            return
        now = self.chosen.depth or self._scene.depth or 1
        self._choose(replace(self.chosen, depth=min(max(now + step, 1), MAX_DEPTH_LIMIT)))

    def _save(self) -> None:
        """An EXR file with variance and metadata, and a PNG as it is shown."""
        if not self.samples:
            self.message = "nothing to save yet"
            return
        depth = "" if self.chosen.depth is None else f"-depth{self.chosen.depth}"
        stem = f"{self._scene.path.stem}-{self.estimator.name}{depth}-{self.samples}spp".replace("/", "_")
        exr, png = self._folder / f"{stem}.exr", self._folder / f"{stem}.png"
        facts = {**self._facts, "strategy": self.estimator.name, "scene": self.scene.name, "spp": self.samples,
                 "exposure": self.chosen.exposure,
                 **{f"harness.{key}": value for key, value in self._renderer().identity.items()}}
        write_estimate(exr, self._sum.estimate(), facts)
        write_png(png, self.image, self.chosen.exposure)
        self.saved += [exr, png]
        self.message = f"saved {exr.name} and .png"
