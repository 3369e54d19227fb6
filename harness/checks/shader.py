"""Adapters: what the checks ask of a sampler, a frame or a generator, of the functions of a shader's library.

Each takes a `Probe`, which evaluates one of glsl/probes/ over rows of inputs; `probe_of(library)` is that of a library.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from harness.checks.chi2 import Pdf, Sample
from harness.checks.domains import Axis, Lobe
from harness.checks.integral import quadrature
from harness.gpu.probes import Picture, evaluate
from harness.scene.strategies import DRAWS
from harness.shader.library import Library

# As probes/sampling.frag numbers them, and the order of pdfs in probes/pdf.frag.
SAMPLERS = ("uniform", "cosine", "lobe")


class Probe(Protocol):
    """How `harness.gpu.probes.evaluate` is called."""

    def __call__(self, name: str, /, *inputs: np.ndarray, outputs: int = 1, uniforms: Mapping[str, Any] | None = None,
                 defines: Mapping[str, object] | None = None,
                 pictures: Mapping[str, Picture] | None = None) -> np.ndarray:
        """Outputs (N, 4 * outputs) of inputs (N, 4)."""


def probe_of(library: Library) -> Probe:
    """The probes of a library: ours, or anybody's files and functions in place of ours."""
    return functools.partial(evaluate, library=library)


def sampler(probe: Probe, name: str, axis: Axis, alpha: float = 0.0) -> tuple[Sample, Pdf]:
    """sample_… and pdf_… of lib/sampling.glsl about an axis that is exact in float32; `name` is one of SAMPLERS."""
    number = SAMPLERS.index(name)

    def sample(u: np.ndarray) -> np.ndarray:
        rows = _rows(len(u), (*axis, alpha)), np.c_[u, np.zeros_like(u)]
        return probe("sampling.frag", *rows, defines={"SAMPLER": number})[:, :3]

    return sample, lambda d: pdfs(probe, d @ np.array(axis), alpha)[:, number]


def pdfs(probe: Probe, cosine: np.ndarray, alpha: float) -> np.ndarray:
    """The three pdfs of lib/sampling.glsl, (N, 3), at cosines (N,) to their axis."""
    rows = np.zeros((len(cosine), 4))
    rows[:, 0], rows[:, 1] = cosine, alpha
    return np.asarray(probe("pdf.frag", rows)[:, :3], dtype=np.float64)


@dataclass(frozen=True)
class Vertex:
    """A Phong material seen about the normal (0,0,1) from `angle` radians; `share` is the lobe's where one is chosen.

    `kd`, `ks`: by channel. A term that is black has no code in the shader, as in the generated code of a scene.
    """

    alpha: float
    angle: float
    kd: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ks: tuple[float, float, float] = (1.0, 1.0, 1.0)
    share: float = 1.0

    @property
    def viewer(self) -> Axis:
        """The unit direction to the viewer."""
        return float(np.sin(self.angle)), 0.0, float(np.cos(self.angle))

    @property
    def mirror(self) -> Axis:
        """The viewer's mirror image, the axis of the lobe."""
        x, y, z = self.viewer
        return -x, -y, z

    @property
    def albedo(self) -> np.ndarray:
        """∫ f cos over the hemisphere, (3,)."""
        return np.array(self.kd) + np.array(self.ks) * lobe_albedo(self.alpha, self.angle)

    def draw(self, probe: Probe, strategy: str, count: int, replica: int = 1, *,
             by_sample: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Directions and weights, (count, 3) both, that the estimator goes on with by one of DRAWS: of as many
        pixels, or `by_sample` of as many samples of one, whose mean is right also where pixels share a sequence."""
        defines = {"STRATEGY": DRAWS.index(strategy), "HAS_DIFFUSE": int(max(self.kd) > 0),
                   "HAS_GLOSSY": int(max(self.ks) > 0), "ROWS_ARE_SAMPLES": int(by_sample)}
        viewer = _rows(count, (*self.viewer, 0.0))
        found = probe("phong.frag", _rows(count, (0.0, 0.0, 1.0, 0.0)), viewer, viewer, outputs=3, defines=defines,
                      uniforms={"kd": self.kd, "ks": self.ks, "alpha": self.alpha, "p_glossy": self.share,
                                "replica": replica})
        return found[:, 4:7], found[:, 8:11]

    def sampler(self, probe: Probe, strategy: str, replica: int = 1) -> tuple[Sample, Pdf]:
        """A strategy's directions, those below the surface included, and their pdf.

        `lobes` and `mixture` draw from the same pair of terms; they differ in what they divide by.
        """
        def pdf(d: np.ndarray) -> np.ndarray:
            uniform, cosine = pdfs(probe, d[:, 2], self.alpha)[:, :2].T
            lobe = pdfs(probe, d @ np.array(self.mirror), self.alpha)[:, 2]
            mixed = (1 - self.share) * cosine + self.share * lobe
            return {"uniform": uniform, "cosine": cosine, "phong": lobe, "lobes": mixed, "mixture": mixed}[strategy]

        return lambda u: self.draw(probe, strategy, len(u), replica)[0], pdf


@functools.cache
def lobe_albedo(alpha: float, angle: float) -> float:
    """∫ (α+1)/(2π) max(r·l, 0)^α max(n·l, 0) dl for a viewer at `angle` radians, by midpoints about r."""
    mirror = np.array([-np.sin(angle), 0.0, np.cos(angle)])

    def reflected(l: np.ndarray) -> np.ndarray:  # noqa: E741
        return np.asarray((alpha + 1) / (2 * np.pi) * np.maximum(l @ mirror, 0)**alpha * np.maximum(l[:, 2], 0))

    return float(quadrature(reflected, Lobe((mirror[0], mirror[1], mirror[2]), alpha)))


def frames(probe: Probe) -> Callable[[np.ndarray], np.ndarray]:
    """Frames (N, 3, 3) about axes (N, 3), rows x, y, z: `to_world` of the library."""
    def make(about: np.ndarray) -> np.ndarray:
        found = probe("basis.frag", np.c_[about, np.zeros(len(about))], outputs=3)
        return np.asarray(found.reshape(-1, 3, 4)[..., :3], dtype=np.float64)

    return make


def random_numbers(probe: Probe, sample: int, side: int = 256) -> np.ndarray:
    """The first eight random numbers of one sample (pass) in each of side² pixels; (side, side, 8), y first."""
    y, x = (grid.ravel() for grid in np.meshgrid(np.arange(side), np.arange(side), indexing="ij"))
    nothing = np.zeros(side * side)
    found = probe("random.frag", np.stack([x, y, nothing, nothing], axis=-1),
                  np.stack([nothing + (sample >> 16), nothing + (sample & 0xFFFF), nothing, nothing], axis=-1),
                  outputs=3)
    return np.asarray(found[:, :8].reshape(side, side, 8), dtype=np.float64)


def _rows(count: int, values: tuple[float, ...]) -> np.ndarray:
    return np.tile(np.array(values), (count, 1))
