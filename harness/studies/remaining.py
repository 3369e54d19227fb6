"""How long a study will take yet: from the seconds that each estimator's samples were measured to take.

What is counted is *work*: samples per pixel times pixels. Every line of a study (an estimator on a scene, a reference)
is expected with the work that was asked for; what a verdict calls for besides becomes known when its first replicas are
drawn, and until then is taken to be what it was on the scenes before.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from harness.progress import Advance

# Half of what is believed of a line's speed comes from its latest samples, this part of its whole: what was read from
# the store, at the beginning, is then soon forgotten.
MEMORY = 1 / 16
# Seconds between two tellings.
PAUSE = 0.25
REFERENCE = "reference"


@dataclass(frozen=True)
class Left:
    """Seconds left, and the share of them that hangs on the speed of estimators of which nothing was measured yet."""

    seconds: float
    guessed: float

    @property
    def told(self) -> str:
        """'about 4 min left'; 'perhaps' while more than half is a guess."""
        return f"{'perhaps' if self.guessed > 0.5 else 'about'} {duration(self.seconds)} left"


@dataclass
class _Line:
    """One estimator on one scene: the work that was asked for, what it has become, what is done, and its speed."""

    what: str
    asked: float
    whole: float
    settled: bool = False
    done: float = 0.0
    ended: bool = False
    start: float | None = None  # seconds until its first samples were there: compiling, most of it; no pace
    _seconds: float = field(default=0.0, repr=False)
    _work: float = field(default=0.0, repr=False)

    def note(self, seconds: float, work: float) -> None:
        """So much more was done in so many seconds."""
        self.done += work
        if self.start is None:
            self.start = seconds
            return
        fades = 0.5 ** (work / (MEMORY * self.whole)) if self.whole > 0 else 1.0
        self._seconds, self._work = self._seconds * fades + seconds, self._work * fades + work

    @property
    def pace(self) -> float | None:
        """Seconds for one unit of work; None before the second samples."""
        return self._seconds / self._work if self._work > 0 else None


class Schedule:
    """All lines of a study, or of many studies; `tell` is told what is left while they are drawn.

    `clock`: seconds that go on. `tell` is called from `working` alone, now and then.
    """

    def __init__(self, tell: Callable[[Left], None] | None = None,
                 clock: Callable[[], float] = time.perf_counter) -> None:
        self._tell, self._clock = tell, clock
        self._lines: dict[tuple[str, str], _Line] = {}
        self._since = self._told = clock()

    def expect(self, scene: str, what: str, work: float) -> None:
        """An estimator will be asked for so much work on a scene; nothing where that was said before."""
        self._lines.setdefault((scene, what), _Line(what, work, work))

    def settle(self, scene: str, what: str, work: float) -> None:
        """It is known by now how much it is in all."""
        line = self._lines[scene, what]
        line.whole, line.settled = work, True

    @contextmanager
    def working(self, scene: str, what: str, work: float) -> Iterator[Advance]:
        """While so much more of a line is drawn; the callback is told work that is done."""
        self.expect(scene, what, work)
        line = self._lines[scene, what]
        line.whole = max(line.whole, line.done + work)
        self._since = self._clock()

        def advance(done: float) -> None:
            line.note(self._elapsed(), done)
            self._say()

        yield advance
        line.note(self._elapsed(), 0.0)

    def end(self, scene: str, what: str) -> None:
        """Nothing more is asked of it."""
        line = self._lines[scene, what]
        line.asked = line.asked or line.done
        line.whole, line.settled, line.ended = line.done, True, True

    def left(self) -> Left | None:
        """What is left; None before anything but first samples was measured."""
        parts = [(self._seconds_of(line), line) for line in self._lines.values() if not line.ended]
        if any(seconds is None for seconds, _ in parts):
            return None
        whole = math.fsum(seconds for seconds, _ in parts if seconds is not None)
        guessed = math.fsum(seconds for seconds, line in parts
                            if seconds is not None and self._pace_of(line.what) is None)
        return Left(whole, guessed / whole if whole else 0.0)

    def _seconds_of(self, line: _Line) -> float | None:
        pace = line.pace or self._pace_of(line.what) or self._pace_of(None)
        if pace is None:  # of the very first samples compiling is most of what they took
            return None
        start = 0.0 if line.start is not None else self._mean_start()
        return start + max(self._whole(line) - line.done, 0.0) * pace

    def _whole(self, line: _Line) -> float:
        """The work of a line: as it is known, or as it would be if its verdict called for as much as elsewhere."""
        if line.settled:
            return line.whole
        ended = [other for other in self._lines.values() if other.ended and other.what == line.what]
        grown = [other.whole / other.asked for other in ended if other.asked]
        return max(line.whole, line.asked * (sum(grown) / len(grown) if grown else 1.0))

    def _pace_of(self, what: str | None) -> float | None:
        """Seconds for one unit of work of an estimator wherever it was measured; of all but references, then of these,
        where None."""
        found = [(line.done, line.pace) for line in self._lines.values()
                 if line.pace is not None and (line.what == what if what is not None else line.what != REFERENCE)]
        if not found:
            return self._pace_of(REFERENCE) if what is None else None
        return sum(work * (pace or 0.0) for work, pace in found) / sum(work for work, _ in found)

    def _mean_start(self) -> float:
        starts = [line.start for line in self._lines.values() if line.start is not None]
        return sum(starts) / len(starts) if starts else 0.0

    def _elapsed(self) -> float:
        now = self._clock()
        elapsed, self._since = now - self._since, now
        return elapsed

    def _say(self) -> None:
        if self._tell is None or self._since - self._told < PAUSE:
            return
        self._told = self._since
        if (left := self.left()) is not None:
            self._tell(left)


def duration(seconds: float) -> str:
    """'40 s', '4 min', '2 h 10 min': as fine as anybody plans by."""
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
