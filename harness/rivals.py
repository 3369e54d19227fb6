"""The tracer against Mitsuba's `path` under each of Mitsuba's samplers: who reaches the same error sooner, by how much.

All but the independent sampler stratify the samples of a replica, which then depend on each other. So variance comes
from whole replicas alone, each one call of Mitsuba, and never from batches within one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field

import numpy as np

from harness.estimators.base import Renderer
from harness.estimators.mitsuba import Mitsuba
from harness.estimators.tracer import Tracer
from harness.policy import CONFIDENCE
from harness.progress import Progress, quiet
from harness.results import SamplerRow
from harness.scene import SceneFile
from harness.scene.sensors import SAMPLERS
from harness.stats.convergence import jackknife
from harness.stats.efficiency import Factor

INTEGRATOR = "path"
# Samples per pixel of a replica: a square, so that none of the samplers but `orthogonal` rounds it up.
SPP = 64


@dataclass(frozen=True)
class Contest:
    """A scene, and the strategy that the tracer enters with."""

    scene: str
    strategy: str


CONTESTS = (Contest("diffuse", "cosine"), Contest("spheres", "mixture"), Contest("environment", "mixture"),
            Contest("displaced", "mixture"))


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

    def efficiency(self) -> Factor:
        """1 / (variance of a replica's pixel, mean over pixels and channels, x its seconds), with the jackknife's
        interval over replicas."""
        images, seconds = np.array(self.images), np.array(self.seconds)

        def logarithm(chosen: np.ndarray) -> float:
            which = chosen[:, 0].astype(int)
            return -math.log(images[which].var(axis=0, ddof=1).mean() * seconds[which].mean())

        _, value, half = jackknife(logarithm, np.arange(len(images))[:, None], CONFIDENCE)
        return Factor(math.exp(value), math.exp(value - half), math.exp(value + half))


def run(contests: Sequence[Contest] = CONTESTS, replicas: int = 8, progress: Progress = quiet) -> list[SamplerRow]:
    """One row a contest and sampler: the renderers in turn, `replicas` times (at least 4)."""
    rows: list[SamplerRow] = []
    with progress(len(contests) * replicas, "samplers at equal error") as advance:
        for contest in contests:
            rows += _hold(contest, replicas, advance)
    return rows


def _hold(contest: Contest, replicas: int, advance: Callable[[float], None]) -> list[SamplerRow]:
    scene = SceneFile.bundled(contest.scene)
    with ExitStack() as stack:
        ours = _Entrant(stack.enter_context(Tracer(contest.strategy).open(scene)), SPP)
        theirs = {}
        for sampler in SAMPLERS:
            renderer = stack.enter_context(Mitsuba(INTEGRATOR, sampler=sampler).open(scene))
            theirs[sampler] = _Entrant(renderer, min(SPP, renderer.samples_per_call))
        for entrant in (ours, *theirs.values()):
            entrant.warm_up()
        for number in range(replicas):
            for entrant in (ours, *theirs.values()):
                entrant.enter(1 + number)
            advance(1)
    efficiency = {sampler: entrant.efficiency() for sampler, entrant in theirs.items()}
    plain, mine = efficiency["independent"], ours.efficiency()
    best = max(efficiency, key=lambda sampler: efficiency[sampler].value)
    return [SamplerRow(contest.scene, contest.strategy, INTEGRATOR, sampler, theirs[sampler].spp, sampler == best,
                       of.value / plain.value, *_interval(mine.over(of)))
            for sampler, of in efficiency.items()]


def _interval(factor: Factor) -> tuple[float, float, float]:
    return factor.value, factor.low, factor.high
