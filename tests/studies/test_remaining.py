"""The time that a study has left, by a clock that the test turns on."""

from __future__ import annotations

import pytest

from harness.studies.remaining import REFERENCE, Left, Schedule, duration


class Clock:
    """Seconds that pass when somebody says so."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class Drawn:
    """A schedule whose lines take what the test says they take."""

    def __init__(self) -> None:
        self.clock, self.told = Clock(), list[Left]()
        self.schedule = Schedule(self.told.append, self.clock)

    def draw(self, scene: str, what: str, batches: list[float], pace: float, start: float = 0.0) -> None:
        """Batches of so much work, `pace` seconds for each unit, and `start` before the first."""
        with self.schedule.working(scene, what, sum(batches)) as advance:
            for index, work in enumerate(batches):
                self.clock.now += pace * work + (0.0 if index else start)
                advance(work)

    def left(self) -> float:
        found = self.schedule.left()
        assert found is not None
        return found.seconds


@pytest.fixture
def drawn() -> Drawn:
    return Drawn()


def test_nothing_is_said_before_anything_was_measured(drawn: Drawn) -> None:
    """Nor of the first samples, which wait for a compiler: taken for the speed, they would make it half an hour."""
    drawn.schedule.expect("ball", "mixture", 100)
    assert drawn.schedule.left() is None
    drawn.draw("ball", "mixture", [1], pace=0.1, start=20)
    assert drawn.schedule.left() is None


def test_each_estimator_is_taken_at_its_own_speed(drawn: Drawn) -> None:
    """Not by counts: half of all samples are done, a tenth of the time has passed."""
    for scene in ("one", "two"):
        drawn.schedule.expect(scene, "fast", 100)
        drawn.schedule.expect(scene, "slow", 100)
    drawn.draw("one", "fast", [10] * 10, pace=0.1)
    drawn.schedule.end("one", "fast")
    drawn.draw("two", "fast", [10] * 10, pace=0.1)
    drawn.schedule.end("two", "fast")
    with drawn.schedule.working("one", "slow", 100) as advance:
        for _ in range(2):
            drawn.clock.now += 10 * 2.0
            advance(10)
    assert drawn.left() == pytest.approx(80 * 2.0 + 100 * 2.0 + (0.1 * 10 + 0.1 * 10 + 20) / 3)


def test_what_compiling_takes_is_not_taken_for_the_speed(drawn: Drawn) -> None:
    """The first sample is late by five seconds; a hundred more take ten."""
    drawn.schedule.expect("one", "mixture", 101)
    with drawn.schedule.working("one", "mixture", 101) as advance:
        drawn.clock.now += 5.1
        advance(1)
        for work in (1, 2, 4):
            drawn.clock.now += 0.1 * work
            advance(work)
        assert drawn.left() == pytest.approx(93 * 0.1)


def test_what_was_read_from_the_store_is_soon_forgotten(drawn: Drawn) -> None:
    drawn.schedule.expect("one", "mixture", 1000)
    with drawn.schedule.working("one", "mixture", 1000) as advance:
        for _ in range(50):
            advance(10)  # read: no time at all
        for _ in range(30):
            drawn.clock.now += 10
            advance(10)
    assert drawn.left() == pytest.approx(200, rel=0.15)


def test_what_a_verdict_calls_for_counts_as_soon_as_it_is_known(drawn: Drawn) -> None:
    drawn.schedule.expect("one", REFERENCE, 10)
    drawn.draw("one", REFERENCE, [5, 5], pace=1.0)
    assert drawn.left() == 0
    drawn.schedule.settle("one", REFERENCE, 80)
    assert drawn.left() == pytest.approx(70)
    drawn.draw("one", REFERENCE, [35], pace=1.0)
    assert drawn.left() == pytest.approx(35)
    drawn.schedule.end("one", REFERENCE)
    assert drawn.left() == 0


def test_scenes_to_come_are_taken_to_need_as_much_more_as_those_before(drawn: Drawn) -> None:
    for scene in ("one", "two"):
        drawn.schedule.expect(scene, "mixture", 10)
    drawn.draw("one", "mixture", [5, 5], pace=1.0)
    drawn.schedule.settle("one", "mixture", 30)
    drawn.draw("one", "mixture", [20], pace=1.0)
    drawn.schedule.end("one", "mixture")
    assert drawn.left() == pytest.approx(5 + 30)  # 5: its start, as long as the first batch before took


def test_a_guess_says_so(drawn: Drawn) -> None:
    """Of an estimator that was not measured anywhere the others' speed is the best there is."""
    drawn.schedule.expect("one", REFERENCE, 10)
    drawn.schedule.expect("one", "mixture", 90)
    drawn.draw("one", REFERENCE, [5, 5], pace=1.0)
    found = drawn.schedule.left()
    assert found is not None and found.guessed == 1.0 and found.told.startswith("perhaps ")
    drawn.draw("one", "mixture", [10, 10], pace=0.5)
    found = drawn.schedule.left()
    assert found == Left(pytest.approx(35), 0.0) and found.told == "about 35 s left"


def test_it_is_told_now_and_then_and_comes_down_with_the_clock(drawn: Drawn) -> None:
    drawn.schedule.expect("one", "mixture", 100)
    drawn.draw("one", "mixture", [1] * 100, pace=0.1)
    assert 25 <= len(drawn.told) <= 40  # a quarter of a second apart, in ten seconds
    seconds = [left.seconds for left in drawn.told]
    assert seconds == sorted(seconds, reverse=True) and seconds[-1] < 0.5


@pytest.mark.parametrize(("seconds", "told"), [(0, "1 s"), (40.4, "40 s"), (240, "4 min"), (7800, "2 h 10 min")])
def test_durations_are_as_fine_as_one_plans_by(seconds: float, told: str) -> None:
    assert duration(seconds) == told
