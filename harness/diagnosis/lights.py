"""What an autopsy says of light sampling, where it found the paths themselves right.

First every function of it is asked at the vertices of the paths (`diagnosis.lit`). Where all are right, whole samples
tell whether the loop puts their answers together: the tracer and the coupled oracle (`harness.estimators.coupled`) draw
the same numbers, so one sample of one pixel is one radiance, twice.

A library that chooses lights, aims at them or weighs in its own way is not wrong for that: its samples are then held
against the oracle's in the mean, which is statistical.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from harness.diagnosis import lit
from harness.diagnosis.case import Case
from harness.diagnosis.light_parts import BEHIND, wrong_light_parts
from harness.diagnosis.place import places
from harness.diagnosis.record import AutopsyRecord
from harness.diagnosis.report import report
from harness.diagnosis.tally import Answers, Tally, Witness
from harness.estimators.base import Estimator
from harness.estimators.coupled import Coupled
from harness.estimators.tracer import Tracer
from harness.samples.estimate import LUMINANCE
from harness.scene import SceneFile
from harness.scene.lights import ENVIRONMENT, lights_sampled
from harness.scene.model import EnvironmentMap
from harness.scene.strategies import Strategy, parse_strategy
from harness.shader.functions import functions
from harness.shader.library import OURS, Library

# Samples of each pixel that are compared, one by one, of a replica that nothing else draws.
SAMPLES, REPLICA = 4, 77
# The share of samples that may differ: paths part at edges; where the oracle shows meshes for displaced spheres, more.
# Those that part by chance do so either way: by so many standard errors their mean may differ, and by so much of it.
SHARE, SHARE_OF_MESHES = 0.01, 0.2
LEAN, LEAST_LEAN = 6.0, 3e-3
# Of a library with its own way: batches of samples of each pixel, and by how many standard errors the means of the
# image or of one of its tiles may be apart. A dozen tiles of a thousand right libraries are by one in 50000 of them.
BATCHES, BATCH, DEVIATE = 24, 16, 6.5
TILES = (4, 3)
NOTE = ("lights: the library has a way of its own to sample or to weigh them, so that was not compared with ours; the "
        "light of whole paths was, in the mean, which is statistical")


@dataclass(eq=False)
class Oracle:
    """The coupled oracle's samples of a scene, each strategy's rendered once, however many libraries are examined."""

    file: SceneFile
    _kept: dict[tuple[str, bool], np.ndarray] = field(default_factory=dict)

    def samples(self, strategy: str) -> np.ndarray:
        """Radiances of single samples, (SAMPLES, H, W, 3) float64."""
        if (strategy, True) not in self._kept:
            self._kept[strategy, True] = single(Coupled(strategy), self.file)
        return self._kept[strategy, True]

    def tiles(self, strategy: str) -> np.ndarray:
        """Means of batches, (BATCHES, 1 + tiles)."""
        if (strategy, False) not in self._kept:
            self._kept[strategy, False] = _tiles(Coupled(strategy), self.file, REPLICA + 1)
        return self._kept[strategy, False]


def with_lights(found: AutopsyRecord, case: Case, how: Strategy, oracle: Oracle | None = None, *,
                strict: bool = False) -> AutopsyRecord:
    """The record, with the stages of light sampling behind those of the paths; `how` is the strategy, of whose draw the
    case is, and has been diagnosed. `strict`: a way of the library's own counts as a defect of ours.

    Nothing is added where the strategy samples no light, the paths are wrong already, or no light is there to sample.
    """
    if found.differs or not lights_sampled(case.scene, how.lights):
        return found
    oracle = oracle or Oracle(case.steps.file)
    of_lights = replace(case, lit=case.library.tracer(case.steps.reading, how.name))
    asked = _of_vertices(of_lights, how)
    if asked is None or not asked.differs:
        whole = _of_samples(of_lights, how, oracle)
        asked = whole if asked is None else replace(whole, stages=(*asked.stages, *whole.stages))
    right = replace(found, strategy=how.name, stages=(*found.stages, *asked.stages))
    if not asked.differs:
        return right
    wrong = replace(asked, strategy=how.name, stages=right.stages, scatter=found.scatter, notes=found.notes)
    if strict or not is_own(case, how):
        return wrong
    return replace(wrong if apart(case.library, how.name, oracle) else right, notes=(*found.notes, NOTE))


def _of_vertices(case: Case, how: Strategy) -> AutopsyRecord | None:
    """The functions at the vertices of the look that is kept."""
    answers = lit.observe(case, how, case.kept[0])
    if answers is None:
        return None

    def asked(witness: Witness | None) -> Tally:
        tally = Tally(case.scene.width * case.scene.height, witness)
        tally.begin(0)
        lit.ask(case, answers, tally)
        return tally

    record = report(case, 1, asked(None), None, asked)
    return record if record.differs else _at_the_poles(case, how, record)


def _at_the_poles(case: Case, how: Strategy, record: AutopsyRecord) -> AutopsyRecord:
    """The record, accusing the draws from an environment map where their parts are wrong at what vertices hardly ever
    draw: the rows about its poles."""
    has_map = isinstance(case.scene.environment, EnvironmentMap) and any(
        light.shape == ENVIRONMENT for light in lights_sampled(case.scene, how.lights))
    if not has_map or not wrong_light_parts(case.library, BEHIND["environment"]):
        return record
    return replace(record, stage="aimed", places=places(case, "aimed", Answers(shapes=Counter({ENVIRONMENT: 1}))))


def _of_samples(case: Case, how: Strategy, oracle: Oracle) -> AutopsyRecord:
    """Whole samples; where they differ and lights are weighed, whether those differ that weigh nothing."""
    record = _compared(case, how, "weighed" if how.lights == "mis" else "lit paths", oracle)
    if record.differs and how.lights == "mis":
        plain = parse_strategy(f"{how.draw}+nee")
        unweighed = replace(case, lit=case.library.tracer(case.steps.reading, plain.name))
        first = _compared(unweighed, plain, "lit paths", oracle)
        record = first if first.differs else replace(record, stages=(*first.stages, *record.stages))
    return record


def _compared(case: Case, how: Strategy, question: str, oracle: Oracle) -> AutopsyRecord:
    theirs = oracle.samples(how.name)
    mine = single(Tracer(how.name, library=case.library), case.steps.file)
    pixels = theirs[0].size // 3
    lanes = np.arange(pixels)
    with np.errstate(all="ignore"):
        relative = np.abs(mine - theirs).max(axis=-1) / (theirs.max(axis=-1) + 0.01 * theirs.mean())
    meshes = any(shape.displacement for shape in case.scene.shapes)
    share = SHARE if not meshes else 0.0 if leans(mine, theirs) else SHARE_OF_MESHES

    def asked(witness: Witness | None) -> Tally:
        tally = Tally(pixels, witness, share=share)
        for number in range(SAMPLES):
            tally.begin(number)
            tally.ask(question, mine[number].reshape(-1, 3), theirs[number].reshape(-1, 3), lanes,
                      difference=relative[number].ravel())
        return tally

    return replace(report(case, SAMPLES, asked(None), None, asked), vertices={})  # whole samples have none


def leans(mine: np.ndarray, theirs: np.ndarray) -> bool:
    """Whether samples (…, 3) are brighter or darker than the oracle's on the whole, and not only other ones."""
    with np.errstate(all="ignore"):
        off, level = (mine - theirs) @ LUMINANCE, (theirs @ LUMINANCE).mean()
        return bool(abs(off.mean()) > max(LEAN * off.std() / np.sqrt(off.size), LEAST_LEAN * level))


def single(estimator: Estimator, file: SceneFile) -> np.ndarray:
    """Radiances of single samples, (SAMPLES, H, W, 3) float64."""
    with estimator.open(file) as renderer:
        return np.stack([renderer.render_batch(REPLICA, number, 1).mean.astype(np.float64)
                         for number in range(SAMPLES)])


def is_own(case: Case, how: Strategy) -> bool:
    """Whether the shader with lights has functions of the library's own: of its files and chunks, whose text is not
    ours. A line exchanged in ours is none: see `own_parts`."""
    library = case.library
    files = {file.shown for file in library.files} | set(library.chunks)
    if not files:
        return False
    theirs, ours = (functions(each.tracer(case.steps.reading, how.name)) for each in (library, OURS))
    return any(at.file in files and (name not in ours or at.text != ours[name].text) for name, at in theirs.items())


def apart(library: Library, strategy: str, oracle: Oracle) -> bool:
    """Whether the means of a library's images and the oracle's differ by more than chance."""
    theirs = oracle.tiles(strategy)
    mine = _tiles(Tracer(strategy, library=library), oracle.file, REPLICA + 2)
    with np.errstate(all="ignore"):
        error = np.sqrt((mine.var(axis=0, ddof=1) + theirs.var(axis=0, ddof=1)) / BATCHES)
        off = np.abs(mine.mean(axis=0) - theirs.mean(axis=0))
    return bool((off > DEVIATE * error + 1e-4 * theirs.mean()).any() or not np.isfinite(mine).all())


def _tiles(estimator: Estimator, file: SceneFile, replica: int) -> np.ndarray:
    """Mean luminance of the image and of its tiles, of each batch."""
    with estimator.open(file) as renderer:
        images = [renderer.render_batch(replica, BATCH * number, BATCH).mean @ LUMINANCE for number in range(BATCHES)]
    return np.array([[image.mean(), *(part.mean() for band in np.array_split(image, TILES[1])
                                      for part in np.array_split(band, TILES[0], axis=1))] for image in images])


