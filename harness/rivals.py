"""The tracer against Mitsuba's `path`, on every scene, each with its own samplers: who reaches the same error sooner.

Nearly all samplers make the samples of a replica depend on each other. So variance comes from whole replicas alone,
each one call of its renderer, and never from batches within one.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field

import numpy as np

from harness.estimators.base import Renderer
from harness.estimators.mitsuba import Mitsuba
from harness.estimators.tracer import Tracer
from harness.files import data_dir
from harness.policy import CONFIDENCE
from harness.progress import Progress, quiet
from harness.results import EntrantRow
from harness.scene import SceneFile, load
from harness.scene.lights import lights_sampled
from harness.scene.sensors import SAMPLERS
from harness.shader.samplers import SAMPLERS as OUR_SAMPLERS
from harness.stats.convergence import jackknife
from harness.stats.efficiency import Factor

INTEGRATOR = "path"
# Samples per pixel of a replica: a square, so that none of Mitsuba's samplers but `orthogonal` rounds it up.
SPP = 64
# Pixels across; the film's shape is the scene's. Half of what most scenes have, so that all of them can be
# measured: what a call of Mitsuba costs whatever its size then weighs more than in a picture.
WIDTH = 96
# Noise that is rounding, as a part of the image's mean.
EXACT = 1e-6
# What the tracer enters with; those with lights where a scene has lights to sample.
PLAIN, LIT = ("mixture",), ("mixture", "nee", "mis")


@dataclass
class _Entrant:
    """One renderer's replicas in a contest."""

    renderer: Renderer
    spp: int
    images: list[np.ndarray] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def warm_up(self) -> None:
        """A replica that does not count: kernels compile."""
        self.renderer.render_batch(0, 0, self.spp)

    def enter(self, replica: int) -> None:
        batch = self.renderer.render_batch(replica, 0, self.spp)
        self.images.append(np.asarray(batch.mean, dtype=np.float64))
        self.seconds.append(batch.cost.seconds)

    @property
    def is_exact(self) -> bool:
        """Whether its image is free of noise, but for rounding: then there is no error to reach."""
        images = np.array(self.images)
        return bool(np.sqrt(images.var(axis=0, ddof=1).mean()) <= EXACT * images.mean())

    def efficiency(self) -> Factor:
        """1 / (variance of a replica's pixel, mean over pixels and channels, x its seconds), with the jackknife's
        interval over replicas."""
        images, seconds = np.array(self.images), np.array(self.seconds)

        def logarithm(chosen: np.ndarray) -> float:
            which = chosen[:, 0].astype(int)
            return -math.log(images[which].var(axis=0, ddof=1).mean() * seconds[which].mean())

        _, value, half = jackknife(logarithm, np.arange(len(images))[:, None], CONFIDENCE)
        return Factor(math.exp(value), math.exp(value - half), math.exp(value + half))


def run(scenes: Sequence[str] | None = None, replicas: int = 8, progress: Progress = quiet) -> list[EntrantRow]:
    """The rows of some bundled scenes, of all where None: all renderers in turn, `replicas` times (at least 4).

    A scene has none where a renderer finds the answer without noise, as in a furnace: no error is left to reach.
    """
    names = sorted(path.stem for path in data_dir("mitsuba_scenes").glob("*.xml")) if scenes is None else scenes
    rows: list[EntrantRow] = []
    with progress(len(names) * replicas, "the same error, how soon") as advance:
        for name in names:
            rows += _hold(name, replicas, advance)
    return rows


def _hold(name: str, replicas: int, advance: Callable[[float], None]) -> list[EntrantRow]:
    film = SceneFile.bundled(name).film
    scene = SceneFile.bundled(name, (WIDTH, max(1, round(WIDTH * film.height / film.width))))
    strategies = LIT if lights_sampled(load(scene), "mis") else PLAIN
    with ExitStack() as stack:
        entrants: dict[tuple[str, str, str], _Entrant] = {}
        for strategy, sampler in itertools.product(strategies, OUR_SAMPLERS):
            renderer = stack.enter_context(Tracer(strategy, sampler=sampler).open(scene))
            entrants["tracer", strategy, sampler] = _Entrant(renderer, SPP)
        for sampler in SAMPLERS:
            theirs = stack.enter_context(Mitsuba(INTEGRATOR, sampler=sampler).open(scene))
            entrants[INTEGRATOR, "", sampler] = _Entrant(theirs, min(SPP, theirs.samples_per_call))
        for entrant in entrants.values():
            entrant.warm_up()
        for number in range(replicas):
            for entrant in entrants.values():
                entrant.enter(1 + number)
            advance(1)
    if any(entrant.is_exact for entrant in entrants.values()):
        return []
    efficiency = {key: entrant.efficiency() for key, entrant in entrants.items()}
    best = {renderer: max((key for key in entrants if key[0] == renderer), key=lambda key: efficiency[key].value)
            for renderer in ("tracer", INTEGRATOR)}
    rows = []
    for key, entrant in entrants.items():
        against = efficiency[best[INTEGRATOR]]
        factor = Factor(1.0, 1.0, 1.0) if key == best[INTEGRATOR] else efficiency[key].over(against)
        rows.append(EntrantRow(name, *key, entrant.spp, key in best.values(), factor.value, factor.low, factor.high))
    return rows
