"""The case: a scene, a strategy and a library under examination, and what of the library is its author's own."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from harness.diagnosis.seen import Seen
from harness.gpu.tap import Tap
from harness.reference.coupled_steps import CoupledSteps
from harness.scene import Scene
from harness.scene.model import Bitmap, Checkerboard, peak
from harness.scene.motion import moving
from harness.shader.functions import Function, functions
from harness.shader.library import OURS, Library
from harness.shader.scene.materials import switches
from harness.shader.source import ShaderSource

# What an author may do in his own way without being wrong, and the functions that do it.
OWN = {
    "generator": ("pcg_hash", "pixel_stream", "seed_sample", "rand"),
    "sampler": ("sample_phong", "sample_lobe", "sample_cosine", "sample_uniform", "direction_about", "to_world"),
    "loop": ("trace_samples", "start_path", "goes_on"),
}


@dataclass(frozen=True, eq=False)
class Case:
    """`steps`: Mitsuba's of the same scene. `own`: which of OWN the library brings in files or functions of its own,
    and "density" where its sampler also has another density than the strategy's. `kept`: looks that are asked about
    more than once, by number. `lit`: the shader that also samples lights, once that is what is looked at."""

    scene: Scene
    strategy: str
    library: Library
    tap: Tap
    steps: CoupledSteps
    own: frozenset[str]
    kept: dict[int, Seen] = field(default_factory=dict)
    lit: ShaderSource | None = None

    @property
    def source(self) -> ShaderSource:
        """The shader that is looked at."""
        return self.lit or self.tap.source

    @property
    def functions(self) -> dict[str, Function]:
        """Its functions by name."""
        return dict(functions(self.lit) if self.lit else self.tap.functions)

    @property
    def has_glossy(self) -> bool:
        """Whether any material has a lobe."""
        return bool(switches(self.scene.shapes)["HAS_GLOSSY"])

    @property
    def emits(self) -> bool:
        """Whether any shape does."""
        return any(shape.emission for shape in self.scene.shapes)

    @property
    def has_lens(self) -> bool:
        """Whether the camera has a lens."""
        return self.scene.camera.aperture_radius > 0

    @property
    def moves(self) -> bool:
        """Whether a shape moves while the shutter is open."""
        return bool(moving(self.scene))

    @property
    def before_scattering(self) -> int:
        """Numbers that a path takes before its first vertex."""
        return 2 + 2 * self.has_lens + self.moves

    @property
    def chooses(self) -> bool:
        """Whether the strategy draws a term first."""
        return self.strategy in ("lobes", "mixture") and self.has_glossy

    @property
    def numbers_of_scattering(self) -> int:
        """Numbers that a path takes at each vertex where it scatters."""
        return 2 + self.chooses

    @property
    def drawn(self) -> str:
        """The strategy; where it chooses between terms and there is only one, "cosine"."""
        return "cosine" if not self.has_glossy and self.strategy in ("lobes", "mixture") else self.strategy

    def of_kind(self, *kinds: str) -> np.ndarray:
        """Of each shape, and of none (the last entry, index -1), whether it is of one of these kinds."""
        return np.array([shape.kind in kinds for shape in self.scene.shapes] + [False])

    def radii(self) -> np.ndarray:
        """Of each shape, and of none, its radius where it is a sphere, else 0."""
        return np.array([float(np.linalg.norm(shape.matrix[:3, :3], axis=0).max()) if "sphere" in shape.kind else 0.0
                         for shape in self.scene.shapes] + [0.0])

    def has_coordinates(self) -> np.ndarray:
        """Of each shape, and of none, whether a texture looks at its (u, v)."""
        found = []
        for shape in self.scene.shapes:
            values = (shape.material.kd, shape.material.ks, shape.material.alpha, shape.emission)
            found.append(any(isinstance(value, Bitmap | Checkerboard) for value in values))
        return np.array([*found, False])

    def contrast_of_light(self) -> np.ndarray:
        """Of each shape, and of none, the peak of its light where that is textured, else 0.

        Between a bright texel and a dark one rounding counts by the bright one.
        """
        return np.array([max(peak(shape.emission)) if shape.emission and not isinstance(shape.emission, tuple) else 0.0
                         for shape in self.scene.shapes] + [0.0])

    def exponents(self) -> np.ndarray:
        """Of each shape, the exponent of its lobe; 0 where it has none, or a texture for it."""
        return np.array([float(shape.material.alpha) if isinstance(shape.material.alpha, float | int)
                         and shape.material.ks != (0.0, 0.0, 0.0) else 0.0 for shape in self.scene.shapes])


def own_parts(library: Library, strategy: str, scene: Scene) -> frozenset[str]:
    """Which of OWN are the author's: functions in files or chunks of the library whose text is not ours.

    A line exchanged in ours is none: who changes a line means the rest to stay.
    """
    if not (library.files or library.chunks):
        return frozenset()
    theirs = functions(library.tracer(scene, strategy))
    ours = functions(OURS.tracer(scene, strategy))
    files = {file.shown for file in library.files} | set(library.chunks)
    return frozenset(part for part, names in OWN.items() if any(
        name in theirs and theirs[name].file in files and (name not in ours or theirs[name].text != ours[name].text)
        for name in names))
