"""The coupled oracle as an estimator: Mitsuba on the tracer's own paths."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from harness.reference.coupled import CoupledRenderer
from harness.scene import SceneFile, load
from harness.scene.strategies import check_strategy, parse_strategy
from harness.shader.samplers import DEFAULT, named, sampler_named


@dataclass(frozen=True)
class Coupled:
    """Mitsuba, by the random numbers and the strategy of `Tracer(strategy, sampler=sampler)`: batch for batch the same
    paths.

    Its image is unbiased like `Mitsuba`'s, and not independent of the tracer's: hold it against that alone, and judge
    differences (`harness.stats.paired`).
    """

    strategy: str = "mixture"
    sampler: str = DEFAULT

    @property
    def name(self) -> str:
        """`coupled mixture`, `coupled mixture sobol`, …"""
        return f"coupled {named(self.strategy, self.sampler)}"

    def check(self, scene: SceneFile) -> str:
        """What light the strategy never finds, in the tracer as here."""
        return check_strategy(load(scene), self.strategy).warning

    def takes_depth(self, scene: SceneFile) -> str:
        """Any depth reaches it."""
        return ""

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[CoupledRenderer]:
        """HarnessError for an unknown strategy or sampler, SceneError for a scene outside our tracer's subset."""
        check_strategy(load(scene), self.strategy)
        how = parse_strategy(self.strategy)
        sampler = sampler_named(self.sampler)
        renderer = CoupledRenderer(scene, how.name, how.draw, how.lights, how.heuristic, sampler.name)
        try:
            yield renderer
        finally:
            renderer.release()
