"""The two sides of a comparison: files, a program's runs or Mitsuba's, each as an estimate and its tiles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from harness.cli.options import not_finite
from harness.cli.output import log, progress
from harness.errors import HarnessError
from harness.estimators.base import Estimator, Renderer
from harness.estimators.images import Images, StoredRuns, shared
from harness.samples.estimate import Estimate, with_luminance
from harness.samples.store import Store
from harness.scene.file import SceneFile
from harness.stats.bias import error_scale
from harness.stats.deviates import half_width
from harness.stats.tiles import TileSamples
from harness.work.run import Run, reference_run, run_of

# Samples of Mitsuba's reference for one of the program's: its noise then widens intervals by an eighth.
REFERENCE_FACTOR = 4
# Runs of which a single one is told what they would buy.
SUGGESTED_RUNS = 8


@dataclass(frozen=True, eq=False)
class Side:
    """One side: `name` as messages call it, `runs` independent runs, `facts` of its first file, and where they are
    images in files, these."""

    name: str
    estimate: Estimate
    tiles: TileSamples
    runs: int
    facts: Mapping[str, object] = field(default_factory=dict)
    stored: StoredRuns | None = None

    @property
    def knows_variance(self) -> bool:
        """True where an interval can be given."""
        return not np.isnan(self.estimate.image_variance).any()

    @property
    def size(self) -> str:
        """'24 x 16'."""
        height, width = self.estimate.mean.shape[:2]
        return f"{width} x {height}"

    @property
    def told(self) -> dict[str, Any]:
        """For JSON: its files, how many runs there are, and samples per pixel in all."""
        files = list(self.stored.files) if self.stored else []
        return {"name": self.name, "files": files, "runs": self.runs, "samples": self.estimate.samples}


def files_side(word: str) -> Side:
    """The images that a word names: a file, a folder, a pattern. HarnessError as `Images`."""
    images = Images.found(word)
    with images.open() as runs:
        for note in runs.notes:
            log(f"note: {note}")
        for warning in runs.warnings:
            log(f"warning: {warning}")
        for file, image in zip(runs.files, runs.images, strict=True):
            if broken := int((~np.isfinite(image.pixels).all(axis=-1)).sum()):
                log(f"warning: {file}: pixels that are not finite: {broken}; metrics that see them are not either")
        return drawn(runs, word if len(images.files) > 1 else str(images.files[0]), len(runs.files), 1,
                     facts=runs.images[0].metadata, stored=runs)


def runs_side(estimator: Estimator, scene: SceneFile, replicas: int, spp: int) -> Side:
    """So many runs of an estimator. HarnessError as it says."""
    with estimator.open(scene) as renderer:
        side = drawn(renderer, estimator.name, replicas, spp)
    if side.estimate.rejected:
        log(f"warning: {side.name}: {not_finite(side.estimate.rejected)}")
    return side


def mitsuba_side(scene: SceneFile, samples: int, store: Store | None) -> Side:
    """Mitsuba's own image of the scene, of so many samples per pixel."""
    from harness.cli.options import MAX_SPP, SCENE_HASH, scene_hash
    from harness.estimators.mitsuba import Mitsuba

    with Mitsuba().open(scene) as renderer:
        run = reference_run(renderer, min(samples, MAX_SPP), store)
        replicas = -(-min(samples, MAX_SPP) // run.spp)
        with progress(replicas * run.spp, f"{scene.name} mitsuba") as advance:
            run.grow(replicas, advance)
        facts = {SCENE_HASH: scene_hash(scene), "exposure": scene.film.exposure}
        return Side(f"mitsuba {renderer.integrator}", run.estimate(), run.tiles(), replicas, facts)


def drawn(renderer: Renderer, name: str, replicas: int, spp: int, *, facts: Mapping[str, object] | None = None,
          stored: StoredRuns | None = None) -> Side:
    """So many runs, each a batch; or the whole answer where the renderer has it from the beginning."""
    run = run_of(renderer, spp)
    with np.errstate(invalid="ignore"), progress(replicas * run.spp, name) as advance:  # of pixels warned of
        run.grow(replicas, advance)
    estimate = run.estimate()
    runs = run.replicas if isinstance(run, Run) else max(estimate.batches, 1)
    return Side(name, estimate, run.tiles(), runs, facts or {}, stored)


def require_comparable(ours: Side, theirs: Side) -> None:
    """HarnessError where the sides differ in size, or, each of them several runs, have one in common."""
    if ours.estimate.mean.shape != theirs.estimate.mean.shape:
        raise HarnessError(f"{ours.name} is {ours.size}, {theirs.name} is {theirs.size}; render both at the same size")
    if ours.stored and theirs.stored and max(len(ours.stored.files), len(theirs.stored.files)) > 1:
        twins = shared(ours.stored, theirs.stored)
        if twins:
            raise HarnessError(f"{twins[0]} and {twins[1]} hold the same pixels, one on either side: a run may not be "
                               "its own reference; give each a seed of its own")


def buys(ours: Side, theirs: Side, alone: Side) -> str:
    """What further runs of the side that is one render without variance would buy, taking its noise from the pixels'
    differences, which noise explains where the render is right."""
    difference = with_luminance(ours.estimate.mean - theirs.estimate.mean)[..., 3]
    scale = float(error_scale(theirs.estimate.image_mean)[3])
    pixels = difference.size
    with np.errstate(invalid="ignore"):
        one = float(np.std(difference)) / np.sqrt(pixels) / scale

    def interval(runs: int) -> str:
        return f"±{float(half_width(np.array(one / np.sqrt(runs)), np.array(runs - 1.0), 0.05)):.1%}"

    pattern = Path(alone.name)
    like = f"'{pattern.with_name(f'{pattern.stem}_*{pattern.suffix}')}'"
    told = f" of about {interval(2)}, {SUGGESTED_RUNS} of {interval(SUGGESTED_RUNS)}" if np.isfinite(one) else ""
    return (f"{alone.name} is one render without variance; a second one with another seed, the two named {like}, gives "
            f"the mean's error an interval{told}")


def smallest_detectable(tolerance: float, mean: Any, tiles: Any) -> dict[str, float]:
    """The smallest bias of luminance that was sure (probability 0.95) to fail: of the mean, and in the larger and the
    smaller tile where it is hardest to see; as `gates.model.GateResult.smallest_detectable`."""
    return {"mean": tolerance + float(mean.smallest_detectable[3]), "coarse": float(tiles.coarse.detectable[1]),
            "fine": float(tiles.fine.detectable[1])}
