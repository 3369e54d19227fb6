"""Why an image of a scene is not the reference: transforms, simulated defects, factors of bounces, and places."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.diagnosis.causes.bounces import Factors, factors, layers
from harness.diagnosis.causes.candidates import Candidate, candidates
from harness.diagnosis.causes.catalogue import Defect
from harness.diagnosis.causes.match import (
    PIXEL_EXCESS,
    Fit,
    Seen,
    apart,
    factor_to,
    fit,
    gain,
    loglik,
    much_like,
    smaller,
)
from harness.diagnosis.causes.record import Cause, Diagnosis, Outcome
from harness.diagnosis.causes.transforms import TransformFit, fitted, inner_pixels
from harness.diagnosis.causes.where import Place, places
from harness.errors import HarnessError, SceneError
from harness.estimators.base import Estimator
from harness.estimators.mitsuba import Mitsuba
from harness.progress import Progress, quiet
from harness.samples.estimate import Estimate
from harness.samples.store import Store
from harness.scene import SceneFile, load
from harness.scene.footprint import BOX

# Candidates are rendered with at most so many pixels; a larger image is merged by whole factors, as a wider box sees.
PIXELS = 5000
# What the log-likelihoods of two pictures must differ by before one is preferred, and what two pictures must differ by
# at the image's noise before they are told apart: e^8 is 3000 to 1.
MARGIN = 8.0
# Where no picture fits, the nearest is told if it takes off at least this part of what the right one's χ² has too much.
MUCH_NEARER = 0.7
TOLD = 3
# A picture whose χ² is at most so much larger fits as well: it lost by its own noise alone, and is told beside.
AS_GOOD = 1.05


def diagnose(scene: SceneFile, found: Estimate, reference: Estimate, *, store: Store | None = None,
             fine: Estimate | None = None, defects: Sequence[Defect] | None = None, truth: Estimator | None = None,
             pictures: Sequence[Candidate] | None = None, besides: Defect | None = None, depths: bool = True,
             where: bool = True,
             progress: Progress = quiet) -> Diagnosis:
    """Say why `found`, an estimate of the scene by any renderer, is not the `reference`; both at the scene's film size.

    `fine`: the reference at twice the width and height, by which half-pixel shifts are found of what our tracer cannot
    hold. `defects`: the whole catalogue unless given; `pictures`: theirs, where they were rendered before. `truth`:
    what factors of bounces are taken from, Mitsuba unless given. `besides`: how the image's rays are spread about their
    pixels, where that is known already; `reference` is as such rays see it, and our pictures are drawn so. `depths`,
    `where`: whether factors of bounces, and places, are asked for. What is rendered goes through the `store`, so a
    scene is paid for once: some two minutes on one core.

    HarnessError where the images differ in size, or where `found` has no variance.
    """
    if found.mean.shape != reference.mean.shape:
        raise HarnessError(f"the image has {found.mean.shape[1]}x{found.mean.shape[0]} pixels and the reference "
                           f"{reference.mean.shape[1]}x{reference.mean.shape[0]}; render both at one size")
    try:
        seen, right = Seen.of(found), Seen.of(reference)
    except ValueError as error:
        raise HarnessError(str(error)) from None
    as_it_is = fit(seen, right)
    if as_it_is.same:
        return Diagnosis("right", (), as_it_is.chi2, 0)
    notes: list[str] = []
    if besides is not None:
        notes.append(f"it has {besides.says} besides, and so had all pictures that it was held against")
        truth = truth or Mitsuba(footprint=besides.footprint or BOX)
    transforms = fitted(seen, right, None if fine is None else Seen.of(fine))
    if pictures is None:
        pictures = _candidates(scene, store, defects, besides, progress, notes)
    factor = factor_to(_size(found), PIXELS)
    small, small_right = Seen.of(smaller(found, factor)), Seen.of(smaller(reference, factor))
    read = _factors(scene, factor, small, truth, store, progress, notes) if depths else None
    found_places = _places(scene, seen, right, notes) if where else ()
    ranking = _ranking(small, small_right, seen, right, pictures, transforms, read)
    outcome, causes = _judged(ranking, small, small_right, as_it_is)
    return Diagnosis(outcome, causes, as_it_is.chi2, len(pictures) + len(transforms), read, found_places, tuple(notes))


class _Ranked:
    """A picture that was compared: what it explains, how well, and the picture itself where it is one of ours."""

    def __init__(self, cause: Cause, score: float, result: Fit, picture: Seen | None) -> None:
        self.cause, self.score, self.fit, self.picture = cause, score, result, picture


def _ranking(small: Seen, small_right: Seen, seen: Seen, right: Seen, pictures: Sequence[Candidate],
             transforms: Sequence[TransformFit], read: Factors | None) -> list[_Ranked]:
    """All explanations, those that are not excluded first, the likeliest first.

    Scores are gains over the right picture, each at the noise of what it is compared with.
    """
    merged = small.mean.shape != seen.mean.shape
    inner = inner_pixels(right.mean.shape)
    mask = None if merged else inner  # then transforms and defects are compared by the same pixels
    ranking: list[_Ranked] = []
    for candidate in pictures:
        if candidate.defects:
            defect, picture = candidate.defects[0], candidate.seen
            rounded = any(each.rounding for each in candidate.defects)
            result = much_like(small, picture, small_right, mask) if rounded else fit(small, picture, mask)
            cause = Cause("defect", defect.id, defect.says, defect.family, defect.formula, result.chi2, result.same,
                          0.0, tuple(other.id for other in candidate.defects[1:]))
            ranking.append(_Ranked(cause, gain(small, picture, small_right, mask), result, picture))
    base = loglik(seen, right, inner)
    for item in transforms:
        cause = Cause("transform", "", item.says, "image", "", item.fit.chi2, item.fit.same, 0.0)
        ranking.append(_Ranked(cause, item.fit.loglik - base, item.fit, None if merged else item.picture))
    if read is not None and read.picture is not None:
        result = fit(small, read.picture, mask)
        cause = Cause("bounces", "", read.says, "bounces", "", result.chi2, result.same, 0.0)
        ranking.append(_Ranked(cause, gain(small, read.picture, small_right, mask), result, read.picture))
    return sorted(ranking, key=lambda item: (not item.fit.same, -item.score))


def _judged(ranking: list[_Ranked], noise: Seen, right: Seen, as_it_is: Fit) -> tuple[Outcome, tuple[Cause, ...]]:
    """The outcome, and the causes that are told: each class of pictures that cannot be told apart, once."""
    ranking = [item for item in ranking
               if item.picture is None or apart(item.picture, right, noise) > MARGIN]  # else it is the right picture
    if not ranking or ranking[0].score < MARGIN:
        return "unknown", ()
    classes = _classes(ranking, noise)
    fitting = [group for group in classes if group[0].fit.same]
    if not fitting:
        best = classes[0][0].cause
        gained = (as_it_is.chi2 - best.chi2) / max(as_it_is.chi2 - 1.0, PIXEL_EXCESS)
        return ("near" if gained > MUCH_NEARER else "unknown"), _told(classes)
    first = fitting[0][0]
    rivals = [group for group in fitting if first.score - group[0].score < MARGIN
              or group[0].fit.chi2 < AS_GOOD * first.fit.chi2]
    chosen = [*rivals, *(group for group in classes if group not in rivals)]
    return ("cause" if len(rivals) == 1 else "several"), _told(chosen)


def _classes(ranking: list[_Ranked], noise: Seen) -> list[list[_Ranked]]:
    """The best few pictures, those together that cannot be told apart at the image's noise: a transform or a factor of
    bounces that does as well as a defect is the same picture in other words, and comes first, being the simpler."""
    classes: list[list[_Ranked]] = []
    for item in ranking:
        home = next((group for group in classes if _alike(group[0], item, noise)), None)
        if home is None:
            if len(classes) > TOLD:
                break
            classes.append([item])
        else:
            home.append(item)
    order = {"transform": 0, "defect": 1, "bounces": 2}
    for group in classes:
        simplest = min((item for item in group if item.fit.same or not group[0].fit.same),
                       key=lambda item: (order[item.cause.kind], -item.score))
        group.remove(simplest)
        group.insert(0, simplest)
    return classes


def _alike(first: _Ranked, item: _Ranked, noise: Seen) -> bool:
    if first.picture is not None and item.picture is not None:
        return apart(first.picture, item.picture, noise) <= MARGIN
    return first.fit.same and item.fit.same and abs(first.score - item.score) <= MARGIN


def _told(classes: Sequence[Sequence[_Ranked]]) -> tuple[Cause, ...]:
    best = classes[0][0].score
    causes = []
    for group in classes[:TOLD]:
        first = group[0].cause
        others = [name for item in group[1:] for name in (item.cause.id, *item.cause.alike) if name]
        alike = tuple(dict.fromkeys(name for name in (*first.alike, *others) if name != first.id))
        causes.append(Cause(first.kind, first.id, first.says, first.family, first.formula, first.chi2, first.same,
                            max(0.0, best - group[0].score), alike))
    return tuple(causes)


def _candidates(scene: SceneFile, store: Store | None, defects: Sequence[Defect] | None, besides: Defect | None,
                progress: Progress, notes: list[str]) -> list[Candidate]:
    """Our tracer's pictures; none where it cannot hold the scene, which is then noted."""
    try:
        reading = load(scene)
    except SceneError as error:
        notes.append(f"no defects were simulated, since our tracer cannot hold the scene: {error}")
        return []
    factor = factor_to((reading.width, reading.height), PIXELS)
    size = (reading.width // factor, reading.height // factor)
    with progress(1.0, "causes") as advance:
        return candidates(scene.sized(*size), store=store, defects=defects, pixels=factor == 1,
                          besides=besides if factor == 1 else None, advance=advance)


def _factors(scene: SceneFile, factor: int, small: Seen, truth: Estimator | None, store: Store | None,
             progress: Progress, notes: list[str]) -> Factors | None:
    height, width = small.mean.shape[:2]
    try:
        with progress(1.0, "bounces") as advance:
            return factors(small, layers(scene.sized(width, height), estimator=truth, store=store, advance=advance))
    except HarnessError as error:
        notes.append(f"no factors of bounces: {error}")
        return None


def _places(scene: SceneFile, seen: Seen, right: Seen, notes: list[str]) -> tuple[Place, ...]:
    height, width = seen.mean.shape[:2]
    try:
        return places(scene.sized(width, height), seen, right)
    except HarnessError as error:
        notes.append(f"no places: {error}")
        return ()


def _size(estimate: Estimate) -> tuple[int, int]:
    height, width = np.shape(estimate.mean)[:2]
    return int(width), int(height)
