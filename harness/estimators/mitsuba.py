"""Mitsuba as an estimator: any scene that it understands, by any of its integrators."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from harness.machine.mitsuba_runtime import REFERENCE_VARIANT
from harness.reference.renderer import FILES_OWN, ReferenceRenderer
from harness.scene import SceneFile


@dataclass(frozen=True)
class Mitsuba:
    """`integrator`: the scene file's own, or another by name; `max_depth`: in place of the file's; `variant`: of
    Mitsuba, such as llvm_ad_spectral."""

    integrator: str = FILES_OWN
    max_depth: int | None = None
    variant: str = REFERENCE_VARIANT

    @property
    def name(self) -> str:
        """`mitsuba`, or `mitsuba path` where the integrator is named."""
        return "mitsuba" if self.integrator == FILES_OWN else f"mitsuba {self.integrator}"

    def check(self, scene: SceneFile) -> str:
        """Whatever the integrator, it is taken at its word."""
        return ""

    def takes_depth(self, scene: SceneFile) -> str:
        """Empty unless it has a depth of its own."""
        return "" if self.max_depth is None else f"{self.name} has a max_depth of its own, {self.max_depth}"

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[ReferenceRenderer]:
        """HarnessError for an unknown integrator or variant, SceneError where Mitsuba refuses the scene."""
        renderer = ReferenceRenderer(scene, self.integrator, max_depth=self.max_depth, variant=self.variant)
        try:
            yield renderer
        finally:
            renderer.release()
