"""The shader as the handout has it: library functions exchanged for those of glsl/course/, for renders and probes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.api import estimate
from harness.estimators.tracer import Tracer
from harness.gpu.probes import Picture, evaluate
from harness.samples.estimate import Estimate
from harness.samples.store import Store
from harness.scene import Scene, SceneFile
from harness.shader.library import OURS as OUR_LIBRARY
from harness.shader.library import Library


@dataclass(frozen=True)
class Variant:
    """Our library, or one with chunks of glsl/course/ in place of its functions."""

    library: Library = OUR_LIBRARY

    def render(self, scene: Scene | SceneFile, strategy: str, spp: int, store: Store | None) -> Estimate:
        """Mean and variance of `spp` samples per pixel. ShaderError where the functions do not compile."""
        return estimate(Tracer(strategy, self.library), scene, spp, store=store)

    def probe(self, name: str, *inputs: np.ndarray, outputs: int = 1, uniforms: Mapping[str, Any] | None = None,
              defines: Mapping[str, object] | None = None,
              pictures: Mapping[str, Picture] | None = None) -> np.ndarray:
        """`probes.evaluate` with these functions, as float64."""
        found = evaluate(name, *inputs, outputs=outputs, uniforms=uniforms, defines=defines, library=self.library,
                         pictures=pictures)
        return found.astype(np.float64)


def _with(*chunks: str, defines: Mapping[str, object] | None = None) -> Variant:
    return Variant(Library().with_functions(*(f"course/{chunk}.glsl" for chunk in chunks), defines=defines))


OURS = Variant()
LOBE_PDF = _with("lobe_pdf", "brdf")
REFLECT = _with("reflect")
REFLECT_REPAIRED = _with("reflect_repaired")
TANGENT = _with("tangent")
BELOW = {name: _with("below_surface", defines={"BELOW": number})
         for number, name in enumerate(("kept", "folded up", "drawn again", "clamped"))}
NOISE = _with("noise")
# The handout's seed is written for an image of 1024² pixels; smaller renders are its lower left corner.
RANDOM = _with("random", defines={"IMAGE_SIZE": "vec2(1024.0)"})
