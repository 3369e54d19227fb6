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
