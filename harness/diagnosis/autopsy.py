"""Runs an autopsy: taps of the production shader beside single steps of Mitsuba, and what their differences accuse."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from harness.diagnosis import paths, vertices
from harness.diagnosis.case import Case, own_parts
from harness.diagnosis.distribution import Distribution
from harness.diagnosis.lights import with_lights
from harness.diagnosis.record import AutopsyRecord
from harness.diagnosis.report import report
from harness.diagnosis.seen import Seen
from harness.diagnosis.shown import ask_display
from harness.diagnosis.tally import Answers, Tally, Witness
from harness.diagnosis.vertex import begin
from harness.errors import HarnessError
from harness.gpu.tap import Look, Tap
from harness.progress import Progress, quiet
from harness.reference.coupled_steps import CoupledSteps
from harness.scene import SceneFile, load
from harness.scene.strategies import check_strategy, parse_strategy
from harness.shader.library import OURS, Library

# A replica and a first sample that are not 0, or a seed that forgets one of them would not show.
REPLICA, FIRST = 3, 5
# Moments of the shutter's interval that the looks take in turn, in [0, 1).
MOMENTS = (0.3, 0.85, 0.6, 0.05)
SAMPLES = 2
# The look that is asked about again, when it is settled what of a library is its author's own.
KEPT = 0
# By which questions a part shows that it behaves otherwise than ours, and the share of answers that must then differ:
# of a sampler with a defect few do, unless it is another one altogether; of a loop of one's own all may follow ours but
# on the few paths where it takes a number more, or where a ray starts.
OTHERWISE = {"generator": (("seed", "numbers"), 0.5),
             "sampler": (("draws", "direction", "frame", "azimuth", "lobe"), 0.05),
             "density": (("weight",), 0.05),
             "loop": (("numbers", "draws", "offset", "origin", "goes on"), 1e-3)}


def looks(case: Case, samples: int) -> Iterator[Look]:
    """Passes that are looked at: the first with what no pass should read, then second passes of two samples each, of
    which the second is observed."""
    size = case.scene.height, case.scene.width, 4
    rng = np.random.default_rng(1)
    for number in range(samples):
        previous = rng.random(size, dtype=np.float32)
        previous[..., 3] = np.rint(2 + 3 * previous[..., 3])
        moment = MOMENTS[number % len(MOMENTS)] if case.moves else None
        if number == 0:
            yield Look(REPLICA, FIRST, 1, 0, 0, previous, moment)
        else:
            yield Look(REPLICA, FIRST + 2 * number - 1, 2, 1, 1, previous, moment)


def examine(case: Case, samples: int, progress: Progress = quiet, witness: Witness | None = None,
            scatter: Distribution | None = None) -> Tally:
    """All questions about `samples` paths of each pixel; of the look of `witness` alone, if one is given. `scatter` is
    told of every vertex."""
    scene = case.scene
    tally = Tally(scene.width * scene.height, witness)
    with progress(samples, "paths") as advance:
        for number, look in enumerate(looks(case, samples)):
            if witness is None or number == witness.look:
                tally.begin(number)
                _examine(case, number, look, tally, scatter)
            advance(1)
    return tally


def _examine(case: Case, number: int, look: Look, tally: Tally, scatter: Distribution | None) -> None:
    scene = case.scene
    opens, closes = scene.camera.shutter
    if look.moment is not None:
        case.steps.move(opens + (closes - opens) * float(np.float32(look.moment)))
    seen = case.kept.get(number) or Seen(look, case.tap.observe(look))
    if number == KEPT:
        case.kept[number] = seen
    with np.errstate(all="ignore"):  # a shader under examination may compute anything
        _ask(case, seen, tally, scatter)
        if number == 0:
            ask_display(case, seen, tally)


def _ask(case: Case, seen: Seen, tally: Tally, scatter: Distribution | None) -> None:
    scene, look = case.scene, seen.look
    alone = np.zeros((scene.width * scene.height, 4))
    if look.tapped:
        alone = case.tap.observe(replace(look, samples=1, tapped=0, number=0)).accumulated.astype(np.float64)
    along = begin(paths.ask_beginning(case, seen, tally), case.before_scattering)
    for vertex in range(scene.max_depth):
        vertices.ask_vertex(case, seen, vertex, along, tally)
        if scatter is not None:
            scatter.add(case, seen, vertex)
    paths.ask_end(case, seen, alone, along.radiance.astype(np.float64), tally)


@contextmanager
def opened(steps: CoupledSteps, strategy: str, library: Library, *, strict: bool = False) -> Iterator[Case]:
    """The case of a library on the scene of `steps`, which libraries may share."""
    own = frozenset[str]() if strict else own_parts(library, strategy, steps.reading)
    tap = Tap(steps.reading, strategy, library)
    try:
        yield settled(Case(steps.scene, strategy, library, tap, steps, own))
    finally:
        tap.release()


def autopsy(file: SceneFile, strategy: str, library: Library = OURS, *, samples: int = SAMPLES, strict: bool = False,
            progress: Progress = quiet) -> AutopsyRecord:
    """Compare the stages of `samples` paths of each pixel with Mitsuba's single steps.

    Of a strategy that samples lights first the paths, and where these are right the lights (`diagnosis.lights`).

    `strict`: a generator, a sampler or a loop of the library's own, or its own way to sample lights, counts as a defect
    of ours.
    HarnessError for an unknown strategy, ShaderError for a library that does not compile, SceneError for a scene
    outside the tracer's subset.
    """
    check_strategy(load(file), strategy)
    how = parse_strategy(strategy)
    with opened(CoupledSteps(file), how.draw, library, strict=strict) as case:
        return with_lights(diagnose(case, samples, progress), case, how, strict=strict)


def settled(case: Case) -> Case:
    """The case whose parts are the author's own only where they also behave otherwise than ours.

    A file of one's own is most often ours with a line changed. Where it draws the numbers and directions that ours
    draws, it means to be ours, and every question is asked. Numbers are settled first: what is made of them is compared
    whichever they are. The look by which all this is settled is observed once.
    """
    own = frozenset[str]()
    for parts in (("generator",), ("sampler", "loop"), ("density",)):
        asked = [part for part in parts if part in case.own or (part == "density" and "sampler" in own)]
        if asked:
            answers = examine(replace(case, own=own), 1).answers
            own |= {part for part in asked if _behaves_otherwise(part, answers)}
    return replace(case, own=own)


def _behaves_otherwise(part: str, answers: Mapping[str, Answers]) -> bool:
    names, share = OTHERWISE[part]
    return any(answers[name].differs > share * answers[name].asked for name in names)


def diagnose(case: Case, samples: int = SAMPLES, progress: Progress = quiet) -> AutopsyRecord:
    """The autopsy of a case that is open."""
    scatter = Distribution() if "sampler" in case.own else None
    tally = examine(case, samples, progress, scatter=scatter)
    if not any(tally.answers[name].asked for name in ("hit", "index")):
        raise HarnessError(f"{case.tap.source.files[0][0]}: it calls none of the library's functions (seed_sample, "
                           "intersect_scene, sample_phong, …), so there is nothing to tap; `harness compare` judges "
                           "its images")
    return report(case, samples, tally, scatter,
                  lambda witness: examine(case, samples, witness=witness))
