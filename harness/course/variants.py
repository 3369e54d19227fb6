"""The shader as the handout has it: library functions exchanged for those of glsl/course/, for renders and probes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from harness.files import data_dir
from harness.gpu.probes import evaluate
from harness.gpu.renderer import TracerRenderer
from harness.samples.estimate import Estimate
from harness.samples.store import Store
from harness.scene import Scene
from harness.shader.overrides import override
from harness.shader.scene.chunk import scene_chunk
from harness.shader.source import ShaderSource, assemble
from harness.work.batches import render_estimate


@dataclass(frozen=True)
class Variant:
    """Chunks of glsl/course/ that take the place of the library's functions, and what they need defined."""

    chunks: tuple[str, ...] = ()
    defines: Mapping[str, object] = field(default_factory=dict)

    def source(self, scene: Scene, strategy: str) -> ShaderSource:
        """The path tracer for one scene and strategy, with these functions in it."""
        root = data_dir("glsl")
        generated = {"scene.glsl": scene_chunk(scene, strategy), **override(root, *self.chunks)}
        return assemble("path_tracer.frag", root, generated, self.defines)

    def renderer(self, scene: Scene, strategy: str) -> TracerRenderer:
        """The tracer with these functions; raises ShaderError where they do not compile."""
        return TracerRenderer(scene, strategy, self.source(scene, strategy))

    def render(self, scene: Scene, strategy: str, spp: int, store: Store | None) -> Estimate:
        """Mean and variance of `spp` samples per pixel."""
        renderer = self.renderer(scene, strategy)
        try:
            return render_estimate(renderer, spp, store=store)
        finally:
            renderer.release()

    def probe(self, name: str, *inputs: np.ndarray, outputs: int = 1, uniforms: Mapping[str, Any] | None = None,
              defines: Mapping[str, object] | None = None) -> np.ndarray:
        """`probes.evaluate` with these functions, as float64."""
        found = evaluate(name, *inputs, outputs=outputs, uniforms=uniforms, defines={**self.defines, **(defines or {})},
                         generated=override(data_dir("glsl"), *self.chunks))
        return found.astype(np.float64)


OURS = Variant()
LOBE_PDF = Variant(("course/lobe_pdf.glsl", "course/brdf.glsl"))
REFLECT = Variant(("course/reflect.glsl",))
REFLECT_REPAIRED = Variant(("course/reflect_repaired.glsl",))
TANGENT = Variant(("course/tangent.glsl",))
BELOW = {name: Variant(("course/below_surface.glsl",), {"BELOW": number})
         for number, name in enumerate(("kept", "folded up", "drawn again", "clamped"))}
NOISE = Variant(("course/noise.glsl",))
# The handout's seed is written for an image of 1024² pixels; smaller renders are its lower left corner.
RANDOM = Variant(("course/random.glsl",), {"IMAGE_SIZE": "vec2(1024.0)"})
