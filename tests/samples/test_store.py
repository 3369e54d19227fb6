"""The batch store: what was rendered once is found again, whole or not at all."""

from __future__ import annotations

import json
import logging
import os
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError, StoreError
from harness.samples.cost import Cost
from harness.samples.estimate import Batch
from harness.samples.store import LONGEST_BATCH, Store, schedule

KEY = {"scene": "0123456789abcdef", "strategy": "mixture", "renderer": "glsl 1"}
COST = Cost(0.5, 0.25, None, "cpu: test", "cpu")


def batch(value: float = 0.5, samples: int = 4, side: int = 8) -> Batch:
    noise = np.random.default_rng(int(1000 * value)).random((side, side, 3))
    return Batch((value + noise).astype(np.float32), samples, rejected=1, cost=COST)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "store")


def files(store: Store) -> list[Path]:
    return sorted(store.root.glob("*/*/*.exr"))


def never() -> Batch:
    raise AssertionError("rendered what the store should hold")


class TestSchedule:
    """Where a run is cut into batches."""

    def test_batches_double_and_then_stay(self) -> None:
        assert schedule(512) == [(0, 1), (1, 1), (2, 2), (4, 4), (8, 8), (16, 16), (32, 32), (64, 64), (128, 128),
                                 (256, 128), (384, 128)]

    @pytest.mark.parametrize("samples", [1, 2, 3, 7, 100, 128, 129, 1000, 4096])
    def test_batches_are_contiguous_and_meet_the_total(self, samples: int) -> None:
        batches = schedule(samples)
        ends = np.cumsum([count for _, count in batches])
        assert [start for start, _ in batches] == [0, *ends[:-1]]
        assert ends[-1] == samples
        assert max(count for _, count in batches) <= LONGEST_BATCH

    @pytest.mark.parametrize("samples", [1, 2, 3, 7, 100, 129, 1000])
    def test_longer_run_extends_a_shorter_one(self, samples: int) -> None:
        """All but the last batch, which the shorter total may have cut."""
        shorter, longer = schedule(samples), schedule(4096)
        assert shorter[:-1] == longer[:len(shorter) - 1]

    def test_powers_of_two_are_prefixes(self) -> None:
        ends = np.cumsum([count for _, count in schedule(4096)])
        assert {2**k for k in range(13)} <= set(ends)

    @pytest.mark.parametrize("samples", [0, -5])
    def test_nothing_to_do_is_refused(self, samples: int) -> None:
        with pytest.raises(HarnessError, match=f"at least 1, found {samples}"):
            schedule(samples)


class TestKeeping:
    """Put and get."""

    def test_what_was_put_is_got(self, store: Store) -> None:
        store.put(KEY, 2, 64, 4, batch())
        found = store.get(KEY, 2, 64, 4)
        assert found is not None
        np.testing.assert_array_equal(found.mean, batch().mean)
        assert (found.samples, found.rejected, found.cost.seconds) == (4, 1, 0.25)

    @pytest.mark.parametrize(("key", "replica", "start", "count"), [
        ({**KEY, "scene": "fedcba9876543210"}, 2, 64, 4),
        ({**KEY, "more": ""}, 2, 64, 4),
        (KEY, 3, 64, 4),
        (KEY, 2, 60, 4),
        (KEY, 2, 64, 8),
    ])
    def test_anything_else_is_not(self, store: Store, key: dict[str, str], replica: int, start: int,
                                  count: int) -> None:
        store.put(KEY, 2, 64, 4, batch())
        assert store.get(key, replica, start, count) is None

    def test_order_of_the_key_does_not_matter(self, store: Store) -> None:
        store.put(KEY, 0, 0, 4, batch())
        assert store.get(dict(reversed(KEY.items())), 0, 0, 4) is not None

    def test_layout_can_be_read_by_people(self, store: Store) -> None:
        store.put(KEY, 2, 64, 4, batch())
        (path,) = files(store)
        assert path.name == "2-64-4.exr"
        assert path.parent.parent.name == path.parent.name[:2] and len(path.parent.name) == 64
        assert json.loads((path.parent / "key.json").read_text()) == KEY

    def test_rendered_once_and_then_read(self, store: Store) -> None:
        first = store.get_or_render(KEY, 0, 0, 4, batch)
        second = Store(store.root).get_or_render(KEY, 0, 0, 4, never)
        np.testing.assert_array_equal(first.mean, second.mean)

    def test_warm_run_repeats_a_cold_one_exactly(self, store: Store) -> None:
        """Whatever precision the renderer returns, both runs see the float32 numbers that are stored."""
        fine = Batch(batch().mean.astype(np.float64) + 1e-12, 4)
        cold = store.get_or_render(KEY, 0, 0, 4, lambda: fine)
        warm = store.get_or_render(KEY, 0, 0, 4, never)
        assert cold.mean.dtype == warm.mean.dtype == np.float32
        np.testing.assert_array_equal(cold.mean, warm.mean)

    def test_batch_of_another_size_is_a_bug_of_the_renderer(self, store: Store) -> None:
        with pytest.raises(ValueError, match="expected a batch of 8 samples, found 4"):
            store.put(KEY, 0, 0, 8, batch(samples=4))
        assert files(store) == []

    def test_what_is_held_but_not_kept_is_read_once(self, store: Store) -> None:
        store.hold(KEY, 0, 0, 4, batch, keep=False)
        store.hold(KEY, 0, 0, 4, never, keep=False)
        assert [path.name for path in files(store)] == ["0-0-4.once.exr"]
        found = Store(store.root).get_or_render(KEY, 0, 0, 4, never, keep=False)
        np.testing.assert_array_equal(found.mean, batch().mean)
        assert files(store) == []

    def test_what_is_kept_need_not_be_held_as_well(self, store: Store) -> None:
        store.hold(KEY, 0, 0, 4, batch)
        store.hold(KEY, 0, 0, 4, never, keep=False)
        store.get_or_render(KEY, 0, 0, 4, never, keep=False)
        assert [path.name for path in files(store)] == ["0-0-4.exr"]

    def test_interrupted_render_stores_nothing(self, store: Store) -> None:
        def interrupted() -> Batch:
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            store.get_or_render(KEY, 0, 0, 4, interrupted)
        assert store.get(KEY, 0, 0, 4) is None

    def test_unwritable_store_is_said(self, tmp_path: Path) -> None:
        (tmp_path / "file").touch()
        with pytest.raises(StoreError, match="cannot be written"):
            Store(tmp_path / "file").put(KEY, 0, 0, 4, batch())


class TestDamage:
    """A damaged file costs one line and one batch."""

    @pytest.mark.parametrize("damage", [
        lambda data: b"",
        lambda data: data[:10],
        lambda data: data[:-1],
        lambda data: data[:500] + b"\xff" * 8 + data[508:],
        lambda data: b"not an image",
    ], ids=["empty", "head", "tail", "middle", "other"])
    def test_damaged_file_is_reported_once_and_rendered_again(
            self, store: Store, damage: Callable[[bytes], bytes], caplog: pytest.LogCaptureFixture) -> None:
        store.put(KEY, 0, 0, 4, batch())
        (path,) = files(store)
        path.write_bytes(damage(path.read_bytes()))
        with caplog.at_level(logging.WARNING):
            again = store.get_or_render(KEY, 0, 0, 4, batch)
            store.get_or_render(KEY, 0, 0, 4, never)
        np.testing.assert_array_equal(again.mean, batch().mean)
        (record,) = caplog.records
        assert str(path) in record.getMessage() and "rendered again" in record.getMessage()
        assert "\n" not in record.getMessage() and record.getMessage().count(";") == 1

    def test_foreign_image_in_its_place_is_not_taken_for_a_batch(self, store: Store) -> None:
        from harness.samples.estimate import Estimate
        from harness.samples.exr import write_estimate

        store.put(KEY, 0, 0, 4, batch())
        write_estimate(files(store)[0], Estimate.exact(np.ones((8, 8, 3))))
        assert store.get(KEY, 0, 0, 4) is None
        assert files(store) == []


class TestSize:
    """The store keeps below its limit by forgetting what was unused for longest."""

    def fill(self, store: Store, count: int) -> None:
        """Replicas 0 … count-1, last used in that order."""
        for replica in range(count):
            store.put(KEY, replica, 0, 4, batch(replica + 1))
            os.utime(files(store)[replica], (1000 + replica, 1000 + replica))

    def test_size_is_what_the_batches_take(self, store: Store) -> None:
        assert store.size() == 0
        self.fill(store, 3)
        assert store.size() == sum(path.stat().st_size for path in files(store))

    def test_prune_removes_the_least_recently_used(self, store: Store) -> None:
        self.fill(store, 4)
        assert store.get(KEY, 0, 0, 4) is not None  # using it makes it the most recent
        whole = store.size()
        removed = store.prune(whole * 6 // 10)
        assert [store.get(KEY, replica, 0, 4) is not None for replica in range(4)] == [True, False, False, True]
        assert removed == whole - store.size()
        assert store.size() <= whole * 6 // 10

    def test_prune_within_the_limit_removes_nothing(self, store: Store) -> None:
        self.fill(store, 2)
        assert store.prune(store.size()) == 0
        assert len(files(store)) == 2

    def test_store_that_outgrows_its_limit_prunes_itself(self, tmp_path: Path) -> None:
        unlimited = Store(tmp_path / "store")
        self.fill(unlimited, 4)
        limit = unlimited.size()
        store = Store(unlimited.root, limit=limit)
        store.put(KEY, 9, 0, 4, batch(9))
        assert store.size() <= limit
        assert store.get(KEY, 9, 0, 4) is not None
        assert store.get(KEY, 0, 0, 4) is None

    def test_files_that_vanish_meanwhile_do_not_matter(self, store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
        """Another process prunes the same store."""
        self.fill(store, 3)
        listing = files(store)
        monkeypatch.setattr(Path, "glob", lambda self, pattern: iter(listing))
        listing[0].unlink()
        assert store.prune(0) > 0
        assert not any(path.exists() for path in listing)


def test_concurrent_writers_and_readers_see_whole_batches(store: Store) -> None:
    """Four threads write and read the same batch, each with a store of its own, as processes would."""
    store.put(KEY, 0, 0, 4, batch())
    failures: list[object] = []

    def work() -> None:
        own = Store(store.root)
        for _ in range(25):
            own.put(KEY, 0, 0, 4, batch())
            found = own.get(KEY, 0, 0, 4)
            if found is None or not np.array_equal(found.mean, batch().mean):
                failures.append(found)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []
    assert [path.name for path in files(store)] == ["0-0-4.exr"]
