"""What a run will cost: fitted to its first samples, held against those after them, never across devices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from harness.errors import HarnessError
from harness.samples.cost import Cost
from harness.samples.estimate import Batch
from harness.samples.store import Store, schedule
from harness.work.forecast import LONGEST_PILOT, PILOT, PILOT_SECONDS, Forecast, forecast
from tests.support.fakes import NoiseRenderer

COUNTS = [count for _, count in schedule(2000)]


class Costing(NoiseRenderer):
    """Batches that take what `seconds` says of (start, count)."""

    def __init__(self, seconds: Callable[[int, int], float], device: Callable[[int], str] = lambda start: "cpu: a",
                 ) -> None:
        super().__init__()
        self._seconds, self._device = seconds, device

    def render_batch(self, replica: int, start: int, count: int,
                     advance: Callable[[float], None] | None = None) -> Batch:
        batch = super().render_batch(replica, start, count, advance)
        return replace(batch, cost=Cost(9.0, self._seconds(start, count), None, self._device(start), "cpu"))


def told(tmp_path: Path, seconds: Callable[[int, int], float]) -> Forecast:
    return forecast(Costing(seconds), Store(tmp_path), 2.0)


def test_a_law_is_found_again(tmp_path: Path) -> None:
    found = told(tmp_path, lambda start, count: 0.25 + 0.5 * count)
    assert (found.per_batch, found.per_sample) == pytest.approx((0.25, 0.5))
    assert found.error == pytest.approx(0)
    assert found.device == "cpu: a"
    assert found.seconds(COUNTS) == pytest.approx(found.setup + 0.25 * len(COUNTS) + 0.5 * 2000)


def test_what_is_compiled_at_first_counts_once_a_worker(tmp_path: Path) -> None:
    plain = told(tmp_path / "a", lambda start, count: count)
    dear = told(tmp_path / "b", lambda start, count: count + (100.0 if start == 0 else 0.0))
    assert (plain.setup, dear.setup) == pytest.approx((2, 102))
    assert dear.per_sample == pytest.approx(plain.per_sample)


def test_it_says_how_far_it_was_off(tmp_path: Path) -> None:
    """Samples that become dearer by a quarter: foretold too low by a fifth. What is told then is of them all."""
    found = told(tmp_path, lambda start, count: count * (1.25 if start == PILOT // 2 else 1.0))
    assert found.error == pytest.approx(-0.2)
    assert found.pilot == PILOT
    assert 1 < found.per_sample < 1.3


def test_a_law_of_nonsense_is_not_used(tmp_path: Path) -> None:
    """A batch costs no less than nothing."""
    found = told(tmp_path, lambda start, count: 0.01 if count < 16 else float(count))
    assert found.per_batch == 0
    assert found.per_sample > 0


def test_the_pilot_is_a_beginning_of_the_run(tmp_path: Path) -> None:
    """It need not be drawn twice, but for what no long run keeps."""
    told(tmp_path, lambda start, count: count)
    store, identity = Store(tmp_path), NoiseRenderer().identity
    assert [start for start, count in schedule(PILOT) if store.has(identity, 0, start, count)] == [8, 16, 32]


@pytest.mark.parametrize(("each", "samples"), [(PILOT_SECONDS / 300, 384), (PILOT_SECONDS / 1e6, LONGEST_PILOT)])
def test_where_samples_take_no_time_it_has_more_of_them(tmp_path: Path, each: float, samples: int) -> None:
    assert told(tmp_path, lambda start, count: each * count).pilot == samples


def test_workers_share_what_there_is() -> None:
    found = Forecast("cpu: a", "cpu", 10.0, 0.0, 1.0, 64, 1.0, 1.0)
    assert found.longest([128] * 8, 1) == 10 + 8 * 128
    assert found.longest([128] * 8, 4) == 10 + 2 * 128
    assert found.longest([128] * 8, 100) == 10 + 128
    assert found.longest([128, 1, 1, 1], 2) == 10 + 128
    assert found.seconds([128] * 8, 4) == 40 + 8 * 128


@pytest.mark.parametrize("device", [lambda start: "cpu: a" if start < 8 else "cpu: b", lambda start: ""])
def test_devices_are_never_mixed(tmp_path: Path, device: Callable[[int], str]) -> None:
    seconds = 1.0 if device(0) else float("nan")
    with pytest.raises(HarnessError, match="a cost is told of one"):
        forecast(Costing(lambda start, count: seconds, device), Store(tmp_path), 2.0)
