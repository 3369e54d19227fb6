"""Mitsuba as an estimator: any scene that it understands, by any of its integrators."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from harness.machine.mitsuba_runtime import REFERENCE_VARIANT
from harness.reference.prepare import INDEPENDENT
from harness.reference.renderer import FILES_OWN, ReferenceRenderer
from harness.scene import SceneFile
from harness.scene.footprint import BOX, Footprint


@dataclass(frozen=True)
class Mitsuba:
    """`integrator`: the scene file's own, or another by name; `max_depth`: in place of the file's; `variant`: of
    Mitsuba, such as llvm_ad_spectral; `sampler`: of Mitsuba, all but the independent one of which make the samples of a
    replica depend on each other; `footprint`: how rays are spread about a pixel's centre."""

    integrator: str = FILES_OWN
    max_depth: int | None = None
    variant: str = REFERENCE_VARIANT
    sampler: str = INDEPENDENT
    footprint: Footprint = BOX

    @property
    def name(self) -> str:
        """`mitsuba`, or `mitsuba path` where the integrator is named, and the sampler where it is not the usual one."""
        words = ("mitsuba", "" if self.integrator == FILES_OWN else self.integrator,
                 "" if self.sampler == INDEPENDENT else self.sampler)
        return " ".join(filter(None, words))

    def check(self, scene: SceneFile) -> str:
        """Whatever the integrator, it is taken at its word."""
        return ""

    def takes_depth(self, scene: SceneFile) -> str:
        """Empty unless it has a depth of its own."""
        return "" if self.max_depth is None else f"{self.name} has a max_depth of its own, {self.max_depth}"

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[ReferenceRenderer]:
        """HarnessError for an unknown integrator or variant, SceneError where Mitsuba refuses the scene."""
        renderer = ReferenceRenderer(scene, self.integrator, max_depth=self.max_depth, variant=self.variant,
                                     sampler=self.sampler, footprint=self.footprint)
        try:
            yield renderer
        finally:
            renderer.release()
