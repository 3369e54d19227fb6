"""What an autopsy counts: of each question how often it was asked, where its answers differ, and by how much."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from harness.diagnosis.questions import ORDER, QUESTIONS

# More answers than this share, and than a dozen by chance, must differ before a question accuses: silhouettes and the
# edges of texels part a few vertices in a hundred thousand of a right shader (see the table in the README's section).
ROUNDED_SHARE, ROUNDED_ANSWERS = 2e-4, 5
# A common shift of all answers on a shape is rounding up to this, and up to this much more for each unit of the
# exponent: drivers' pow is off by its own rounding of a logarithm times the exponent.
SHIFT, SHIFT_PER_EXPONENT = 2e-6, 3e-7
# So many standard errors beyond it a shift is one; and of so many answers at least.
SHIFT_ERRORS, SHIFT_ANSWERS = 6.0, 60


@dataclass(frozen=True)
class Witness:
    """The path whose numbers are shown: its look, its row, and the vertex at which it differs first."""

    look: int
    lane: int
    vertex: int


@dataclass(frozen=True)
class Shift:
    """A common relative difference of all answers on one shape: its median and the standard error of that."""

    shape: int
    median: float
    error: float


@dataclass
class Answers:
    """The answers to one question. `first`: of how many paths it is the first that differs; `shapes` and `notes`: of
    those, by the shape, and by what the question noted; `certain`: of those, what no rounding explains; `vertices`: by
    the vertex; `map`: by pixel, (N,)."""

    asked: int = 0
    differs: int = 0
    first: int = 0
    certain: int = 0
    largest: float = 0.0
    shapes: Counter[int] = field(default_factory=Counter)
    notes: Counter[str] = field(default_factory=Counter)
    vertices: Counter[int] = field(default_factory=Counter)
    map: np.ndarray | None = None
    witness: Witness | None = None
    witnessed: float = 0.0
    signed: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)


class Tally:
    """Counts over the looks of one autopsy; `pixels` of the image. Rows of the table of one path are kept for
    `witness`, where one is given. `share`: of the answers to a question, that may differ whatever rounding does."""

    def __init__(self, pixels: int, witness: Witness | None = None, share: float = 0.0) -> None:
        self.answers = {name: Answers() for name in QUESTIONS}
        self.paths = 0
        self.rows: list[tuple[str, int, list[float], list[float], bool]] = []
        self._pixels, self._witness, self._look, self._share = pixels, witness, -1, share
        self._undecided = np.zeros(0, dtype=bool)

    def begin(self, look: int) -> None:
        """What follows is about the paths of another look."""
        self._look = look
        self.paths += self._pixels
        self._undecided = np.ones(self._pixels, dtype=bool)

    def ask(self, name: str, mine: np.ndarray, theirs: np.ndarray, lanes: np.ndarray, *, vertex: int = 0,
            difference: np.ndarray | None = None, slack: np.ndarray | float = 1.0, shapes: np.ndarray | None = None,
            notes: Sequence[tuple[str, np.ndarray]] = (), certain: np.ndarray | None = None) -> None:
        """Compare what the shader has, `mine`, with what it should be, `theirs`, on the paths `lanes` (M,).

        Both (M,) or (M, k). `difference` (M,) in the question's measure, the largest of the components if not given;
        `slack`: so many times the tolerance is allowed. `shapes` (M,): what the answers are about. `notes`: words, each
        with the answers (M,) that it holds for. `certain` (M,): differences that rounding is known not to explain.
        """
        if difference is None:
            difference = np.abs(np.asarray(mine, dtype=np.float64) - theirs)
            difference = difference.max(axis=1) if difference.ndim == 2 else difference
        difference = np.where(np.isfinite(difference), difference, np.inf)
        wrong = difference > QUESTIONS[name].tolerance * np.asarray(slack)
        self._row(name, mine, theirs, lanes, vertex, wrong)
        answers = self.answers[name]
        answers.asked += len(lanes)
        answers.differs += int(wrong.sum())
        fresh = wrong & self._undecided[lanes]
        if not fresh.any():
            return
        self._undecided[lanes[fresh]] = False
        answers.first += int(fresh.sum())
        if certain is not None:
            answers.certain += int((fresh & certain).sum())
        answers.vertices[vertex] += int(fresh.sum())
        if answers.map is None:
            answers.map = np.zeros(self._pixels)
        answers.map[lanes[fresh]] += 1
        if shapes is not None:
            answers.shapes.update(shapes[fresh].tolist())
        for word, holds in notes:
            answers.notes[word] += int((fresh & holds).sum())
        finite = np.where(np.isfinite(difference), difference, 1e30)
        answers.largest = max(answers.largest, float(finite[fresh].max()))
        worst = int(np.argmax(np.where(fresh, finite, -1.0)))
        if answers.witness is None or finite[worst] > answers.witnessed:
            answers.witness = Witness(self._look, int(lanes[worst]), vertex)
            answers.witnessed = float(finite[worst])

    def note_shift(self, name: str, mine: np.ndarray, theirs: np.ndarray, shapes: np.ndarray) -> None:
        """Remember signed relative differences (M,), so that a shift too small for one vertex shows over all."""
        known = np.isfinite(mine) & (theirs > 1e-3)
        if known.any():
            self.answers[name].signed.append((shapes[known], (mine[known] - theirs[known]) / theirs[known]))

    def accused(self) -> str | None:
        """The first question at which more paths begin to differ than rounding makes, or one that it cannot explain."""
        guilty = [name for name, answers in self.answers.items()
                  if answers.first > max(_allowed(answers.asked), self._share * answers.asked) or answers.certain]
        return min(guilty, key=ORDER.__getitem__) if guilty else None

    def shifted(self, exponents: np.ndarray) -> tuple[str, Shift] | None:
        """The first question whose answers on a shape are all off by the same little; `exponents` (S,) by shape."""
        for name, answers in self.answers.items():
            if not answers.signed:
                continue
            shapes, values = (np.concatenate(each) for each in zip(*answers.signed, strict=True))
            for shape in np.unique(shapes):
                found = values[shapes == shape]
                if len(found) < SHIFT_ANSWERS:
                    continue
                low, median, high = np.quantile(found, [0.25, 0.5, 0.75])
                # Of a normal distribution: the median's standard error, and its quartiles 1.349 deviations apart.
                error = 1.2533 * (high - low) / 1.349 / math.sqrt(len(found))
                exponent = exponents[shape] if 0 <= shape < len(exponents) else 0.0
                if abs(median) > SHIFT + SHIFT_PER_EXPONENT * exponent + SHIFT_ERRORS * error:
                    return name, Shift(int(shape), float(median), float(error))
        return None

    def _row(self, name: str, mine: np.ndarray, theirs: np.ndarray, lanes: np.ndarray, vertex: int,
             wrong: np.ndarray) -> None:
        """Keep the numbers of the path that is shown: what it has before its vertex, and at it."""
        if self._witness is None or self._look != self._witness.look or vertex not in (0, self._witness.vertex):
            return
        at = np.flatnonzero(lanes == self._witness.lane)
        if len(at):
            self.rows.append((name, vertex, np.atleast_1d(mine[at[0]]).astype(float).tolist(),
                              np.atleast_1d(theirs[at[0]]).astype(float).tolist(), bool(wrong[at[0]])))


def _allowed(asked: int) -> float:
    """How many answers of a right shader rounding may turn."""
    expected = ROUNDED_SHARE * asked
    return ROUNDED_ANSWERS + expected + 3 * math.sqrt(expected)
