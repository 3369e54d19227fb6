"""From counts to the record: the first stage that differs, its functions, where in the image, and one path."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness.diagnosis.case import Case
from harness.diagnosis.distribution import Distribution
from harness.diagnosis.place import places
from harness.diagnosis.questions import QUESTIONS
from harness.diagnosis.record import AutopsyRecord, Row, ShiftRecord, StageRecord, Where
from harness.diagnosis.tally import Answers, Shift, Tally, Witness

# Cells of the map of shares, along each side of the image.
MAP_CELLS = (16, 12)
_NOTES = {
    "generator": "random numbers: the library has a generator of its own, so streams, seeds and numbers were not "
                 "compared with ours; of the film's points it was asked whether they lie evenly in their pixels",
    "sampler": "directions: the library has a sampler of its own, so lobes, azimuths and directions were not compared "
               "one by one, but how often it draws which, which is statistical",
    "density": "weights: its sampler has another density than the strategy's, so weights were not compared one by one; "
               "the light that it scatters was compared with Mitsuba's own sampling",
    "loop": "the loop: the library has one of its own (it may end paths by chance), so the order of numbers, where "
            "rays start, whether a path goes on and the sum of its light were not compared",
}


def report(case: Case, samples: int, tally: Tally, scatter: Distribution | None,
           again: Callable[[Witness], Tally]) -> AutopsyRecord:
    """The record; `again` examines a look once more, keeping the numbers of one path."""
    name, shift = tally.accused(), None
    if name is None and (found := tally.shifted(case.exponents())) is not None:
        name, shift = found
    answers = tally.answers[name] if name else Answers()
    if shift is not None:
        answers = _of_shift(name, answers, shift)
    tested = scatter.record() if scatter is not None else None
    if name is None and scatter is not None and tested is not None and tested.fails:
        # Right weights of directions that come too often or too seldom, or else their product.
        name = "weight" if "density" in case.own else "direction"
        answers = Answers(notes=scatter.samplers)
    rows: tuple[Row, ...] = ()
    if answers.witness is not None:
        rows = tuple(Row(stage, vertex, tuple(mine), tuple(theirs), differs)
                     for stage, vertex, mine, theirs, differs in again(answers.witness).rows)
    scene = case.scene
    return AutopsyRecord(
        scene=scene.name, strategy=case.strategy, size=(scene.width, scene.height), samples=samples,
        paths=tally.paths, stage=name, places=places(case, name, answers) if name else (),
        vertices=dict(sorted(answers.vertices.items())), where=_where(case, answers, samples),
        shift=_named(case, shift), stages=tuple(_stage(each, tally.answers[each]) for each in QUESTIONS
                                                if tally.answers[each].asked),
        path=rows, scatter=tested, notes=tuple(_NOTES[part] for part in sorted(case.own)))


def _of_shift(name: str | None, answers: Answers, shift: Shift) -> Answers:
    """What points to the functions of a stage whose answers are all off alike on one shape."""
    found = Answers(asked=answers.asked, first=answers.asked)
    found.shapes[shift.shape] = answers.asked
    words = {"pdf": "pdf_lobe", "material": "kd"}
    if name in words:
        found.notes[words[name]] = answers.asked
    return found


def _named(case: Case, shift: Shift | None) -> ShiftRecord | None:
    if shift is None:
        return None
    name = case.scene.shapes[shift.shape].name if shift.shape >= 0 else "the environment"
    return ShiftRecord(shift.shape, name, shift.median, shift.error)


def _stage(name: str, answers: Answers) -> StageRecord:
    question = QUESTIONS[name]
    return StageRecord(name, question.asks, answers.asked, answers.differs, answers.first, answers.largest,
                       question.measure, question.tolerance)


def _where(case: Case, answers: Answers, samples: int) -> Where | None:
    if answers.map is None:
        return None
    width, height = case.scene.width, case.scene.height
    shares = answers.map.reshape(height, width) / samples
    rows, columns = np.nonzero(shares)
    # Of equal shares the pixel nearest to the middle of those that have it.
    worst = np.argwhere(shares == shares.max())
    row, column = worst[np.argmin(((worst - worst.mean(axis=0))**2).sum(axis=1))]
    return Where((int(columns.min()), int(rows.min()), int(columns.max()), int(rows.max())), (int(column), int(row)),
                 float(shares.max()), len(rows), _coarse(shares))


def _coarse(shares: np.ndarray) -> tuple[tuple[float, ...], ...]:
    """Means over cells of the image, row 0 at the top."""
    columns, rows = (min(cells, side) for cells, side in zip(MAP_CELLS, shares.shape[::-1], strict=True))
    cells = [[part.mean() for part in np.array_split(band, columns, axis=1)]
             for band in np.array_split(shares, rows, axis=0)]
    return tuple(tuple(float(value) for value in band) for band in cells)
