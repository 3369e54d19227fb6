"""Where elapsed time goes: each second to one name, and nothing where nobody asks."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from harness.cli import main
from harness.samples import spent as module
from harness.samples.spent import REST, Spending, spent, unwatch


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[float]]:
    """A clock that goes on when a test says so: its one element is the time."""
    now = [100.0]
    monkeypatch.setattr(module.time, "perf_counter", lambda: now[0])
    yield now
    unwatch()


def test_a_second_counts_for_the_innermost_span(clock: list[float]) -> None:
    spending = Spending(began=clock[0])
    with spending.span("study"):
        clock[0] += 1
        with spending.span("tracer"):
            clock[0] += 4
        clock[0] += 2
    clock[0] += 3
    with spending.span("tracer"):
        clock[0] += 10
    assert spending.table() == [("tracer", 14.0), ("study", 3.0), (REST, 3.0)]
    assert spending.outside() == pytest.approx(6 / 20)


def test_a_span_that_ends_in_an_error_has_ended(clock: list[float]) -> None:
    spending = Spending(began=clock[0])
    with pytest.raises(ValueError, match="seven"), spending.span("metrics"):
        clock[0] += 2
        raise ValueError("seven")
    clock[0] += 1
    assert spending.table() == [("metrics", 2.0), (REST, 1.0)]


def test_other_threads_do_not_count_twice(clock: list[float]) -> None:
    """They work beside the one whose time is told."""
    spending = Spending(began=clock[0])

    def work() -> None:
        with spending.span("tracer"):
            clock[0] += 5

    with spending.span("waiting"):
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
    assert spending.table() == [("waiting", 5.0), (REST, 0.0)]


def test_nothing_is_counted_unless_asked(clock: list[float]) -> None:
    @spent("metrics")
    def measured() -> int:
        clock[0] += 1
        return 7

    assert measured() == 7
    spending = module.watch()
    assert measured() == 7
    assert spending.seconds["metrics"] == 1.0
    unwatch()
    assert measured() == 7
    assert spending.seconds["metrics"] == 1.0


def test_a_command_tells_it_at_its_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = "mitsuba_scenes/furnace_convex.xml"
    assert main(["render", scene, "--size", "8x8", "--spp", "1", "--no-cache", "--profile-time", "--json",
                 "-o", str(tmp_path / "image.exr")]) == 0
    told = [line for line in capsys.readouterr().err.splitlines() if line.startswith("time: ")]
    assert any(line.endswith("  tracer") for line in told)
    assert told[-2].split()[-3:] == ["s", "100.0%", "elapsed"]
    assert told[-1].endswith("% outside the renderers")
    assert module._spending is None


def test_what_other_processes_spent_takes_the_place_of_the_wait_for_them(clock: list[float]) -> None:
    """Two of them, 30 seconds each, for 31 seconds."""
    spending = Spending(began=clock[0])
    with spending.span("tracer"):
        clock[0] += 5
    clock[0] += 31 + 2
    spending.join([[("tracer", 20.0), (REST, 10.0)], [("Mitsuba", 29.0), (REST, 1.0)]], waited=31)
    assert spending.table() == [("Mitsuba", 29.0), ("tracer", 25.0), (REST, 13.0)]
    assert spending.outside() == pytest.approx(13 / 67)


def test_a_watch_of_a_part_begins_with_it(clock: list[float]) -> None:
    spending = module.watch(since_start=False)
    clock[0] += 2
    assert spending.table() == [(REST, 2.0)]
