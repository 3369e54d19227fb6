"""What an autopsy says of light sampling, where it found the paths themselves right.

The taps follow a path and not its rays to lights. Whole samples tell of these: the tracer and the coupled oracle
(`harness.estimators.coupled`) draw the same numbers, so one sample of one pixel is one radiance, twice. Asked are, in
this order, samples lit at their first vertex alone, samples of whole paths that gather nothing else, and samples that
weigh what is met against what is sampled: the first that differs leaves little code to look at.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.diagnosis.record import AutopsyRecord, Place, StageRecord
from harness.estimators.base import Estimator
from harness.estimators.coupled import Coupled
from harness.estimators.tracer import Tracer
from harness.scene import Scene, SceneFile, load
from harness.scene.lights import ENVIRONMENT, lights_sampled
from harness.scene.strategies import Strategy
from harness.shader.functions import functions
from harness.shader.library import Library

# Samples of each pixel that are compared, one by one, of a replica that nothing else draws.
SAMPLES, REPLICA = 4, 77
# A sample differs by more than this part of itself, and of a hundredth of the mean: rounding stays below it but for the
# few paths that part.
TOLERANCE = 2e-3
# The share of samples that may differ: paths part at edges; where the oracle shows meshes for displaced spheres, more.
SHARE, SHARE_OF_MESHES = 0.01, 0.2
MEASURE = "relative, of a sample's radiance and a hundredth of the mean"
# What draws towards a shape, and its density, in lib/lights.glsl and lib/environment.glsl.
_DRAWS = {"sphere": ("sample_sphere", "sample_ball", "ball_cap", "sample_around"),
          "displacedsphere": ("sample_ball", "ball_cap"), "rectangle": ("sample_rectangle", "towards"),
          "disk": ("sample_disk_light", "towards", "sample_disk"),
          "cube": ("sample_cube", "faces_seen", "towards", "sample_around"),
          "cylinder": ("sample_cylinder", "cylinder_arc", "towards")}
_DENSITIES = {"sphere": ("pdf_ball", "ball_cap"), "displacedsphere": ("pdf_ball", "ball_cap"),
              "rectangle": ("pdf_area",), "disk": ("pdf_area",), "cube": ("pdf_cube", "faces_seen", "pdf_area"),
              "cylinder": ("pdf_cylinder", "cylinder_arc", "pdf_area")}


@dataclass(frozen=True)
class _Stage:
    """A question: the way to light (`nee` or `mis`), whether at the first vertex alone, and the functions behind it."""

    name: str
    asks: str
    way: str
    first_vertex: bool = False


_STAGES = (
    _Stage("light sampled", "what a light sends to the first vertex, sampled: which, where, how likely, and if seen",
           "nee", first_vertex=True),
    _Stage("light counted", "where paths gather sampled light, and what of the light that they meet", "nee"),
    _Stage("light weighed", "the weights of light that is met and light that is sampled", "mis"),
)


def with_lights(found: AutopsyRecord, file: SceneFile, how: Strategy, library: Library) -> AutopsyRecord:
    """The record, with the stages of light sampling behind those of the paths; `how` is the strategy, `file` the scene.

    Nothing is added where the strategy samples no light, the paths are wrong already, or no light is there to sample.
    """
    reading = load(file)
    if found.differs or not lights_sampled(reading, how.lights):
        return found
    share = SHARE_OF_MESHES if any(shape.displacement for shape in reading.shapes) else SHARE
    stages = []
    for stage in _STAGES:
        if stage.way == "mis" and how.lights != "mis":
            break
        asked, differing, largest = _compare(replace(file, max_depth=2) if stage.first_vertex else file,
                                             f"{how.draw}+{stage.way}", how, library)
        wrong = differing > share * asked
        stages.append(StageRecord(stage.name, stage.asks, asked, differing, differing if wrong else 0, largest, MEASURE,
                                  TOLERANCE))
        if wrong:
            return replace(found, stage=stage.name, stages=(*found.stages, *stages),
                           places=tuple(_places(reading, stage, how, library)))
    return replace(found, stages=(*found.stages, *stages))


def _compare(file: SceneFile, strategy: str, how: Strategy, library: Library) -> tuple[int, int, float]:
    """How many samples were compared, how many differ, and the largest relative difference."""
    named = f"{strategy}-{how.heuristic}" if strategy.endswith("mis") else strategy
    mine, theirs = (_single(each, file) for each in (Tracer(named, library=library), Coupled(named)))
    off = np.abs(mine - theirs).max(axis=-1)
    relative = off / (theirs.max(axis=-1) + 0.01 * theirs.mean())
    return off.size, int((~(relative <= TOLERANCE)).sum()), float(np.nanmax(relative))


def _single(estimator: Estimator, file: SceneFile) -> np.ndarray:
    """Radiances of single samples, (SAMPLES, H, W, 3) float64."""
    with estimator.open(file) as renderer:
        return np.stack([renderer.render_batch(REPLICA, number, 1).mean.astype(np.float64)
                         for number in range(SAMPLES)])


def _places(scene: Scene, stage: _Stage, how: Strategy, library: Library) -> Iterator[Place]:
    """The functions behind a stage that the shader has, likeliest first."""
    source = library.tracer(scene, f"{how.draw}+{stage.way}")
    known, texts = functions(source), dict(source.files)
    for name in dict.fromkeys(_functions(scene, stage)):
        if name in known:
            at = known[name]
            yield Place(name, at.file, at.line, texts[at.file].splitlines()[at.line - 1].strip())


def _functions(scene: Scene, stage: _Stage) -> Sequence[str]:
    lights = lights_sampled(scene, stage.way)
    kinds = [scene.shapes[light.shape].kind for light in lights if light.shape != ENVIRONMENT]
    sky = any(light.shape == ENVIRONMENT for light in lights)
    if stage.way == "mis":
        return ["mis_weight", "pdf_phong", "pdf_bsdf", "sample_bsdf",
                *(name for kind in kinds for name in _DENSITIES[kind]), "trace_samples", "aim_at_light"]
    if not stage.first_vertex:
        return ["trace_samples", "aim_at_light"]
    return [*(name for kind in kinds for name in _DRAWS[kind]),
            *(("sample_environment_texel", "sample_tent", "sample_cap", "place_in_run") if sky else ()),
            "aim_at_light", "light_reached", "eval_bsdf", "eval_phong"]
