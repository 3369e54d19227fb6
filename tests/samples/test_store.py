"""The batch store: what was rendered once is found again, whole or not at all."""

from __future__ import annotations

import dataclasses
import errno
import json
import logging
import math
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import harness
from harness.errors import HarnessError, StoreError
from harness.files import PARTIAL_PREFIX
from harness.samples.cost import Cost
from harness.samples.estimate import Batch
from harness.samples.inventory import inventory, prune
from harness.samples.store import LONGEST_BATCH, SET_ASIDE, Store, schedule
from tests.support.fakes import NoiseRenderer

ROOT = Path(harness.__file__).parents[1]
KEY = {"scene": "0123456789abcdef", "strategy": "mixture", "renderer": "glsl 1"}
COST = Cost(0.5, 0.25, None, "cpu: test", "cpu")


def batch(value: float = 0.5, samples: int = 4, side: int = 8) -> Batch:
    noise = np.random.default_rng(int(1000 * value)).random((side, side, 3))
    return Batch((value + noise).astype(np.float32), samples, rejected=1, cost=COST)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "store")


def files(store: Store) -> list[Path]:
    return sorted(store.root.glob("??/*/*.exr"))


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

    @pytest.mark.parametrize(("seconds", "squeezed"), [(1e-5, False), (0.25, True), (math.nan, True)])
    def test_what_was_dear_to_draw_takes_less_room(self, store: Store, seconds: float, squeezed: bool) -> None:
        """Compressing would take as long as drawing took, else."""
        smooth = np.zeros((64, 64, 3), np.float32)
        store.put(KEY, 0, 0, 1, Batch(smooth, 1, cost=dataclasses.replace(COST, cpu=seconds)))
        assert (files(store)[0].stat().st_size < smooth.nbytes) is squeezed

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
        lambda data: data[:-20] + bytes((data[-20] ^ 1,)) + data[-19:],
        lambda data: b"not an image",
    ], ids=["empty", "head", "tail", "middle", "bit", "other"])
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

    def test_damaged_file_is_set_aside_as_it_is(self, store: Store) -> None:
        """Somebody may want to know what happened to it."""
        store.put(KEY, 3, 0, 4, batch())
        (path,) = files(store)
        path.write_bytes(whole := path.read_bytes()[:-1])
        assert store.get(KEY, 3, 0, 4) is None
        assert files(store) == []
        (aside,) = (store.root / SET_ASIDE).iterdir()
        assert aside.name.startswith(f"{path.parent.name[:16]}-3-0-4-") and aside.read_bytes() == whole
        assert store.prune(0) == len(whole), "it takes room as batches do, and goes as they do"

    def test_foreign_image_in_its_place_is_not_taken_for_a_batch(self, store: Store) -> None:
        from harness.samples.estimate import Estimate
        from harness.samples.exr import write_estimate

        store.put(KEY, 0, 0, 4, batch())
        write_estimate(files(store)[0], Estimate.exact(np.ones((8, 8, 3))))
        assert store.get(KEY, 0, 0, 4) is None
        assert files(store) == []

    @pytest.mark.parametrize(("key", "place"), [(KEY, (1, 0, 4)), (KEY, (0, 4, 4)), (KEY, (0, 0, 8)),
                                                ({**KEY, "scene": "another"}, (0, 0, 4))])
    def test_a_sound_batch_of_another_place_is_not_taken_for_this_ones(
            self, store: Store, key: dict[str, str], place: tuple[int, int, int],
            caplog: pytest.LogCaptureFixture) -> None:
        """Copied by hand, say: its numbers would be those of other samples."""
        store.put(KEY, 0, 0, 4, batch())
        store.put(key, *place, batch(samples=place[2]))
        wrong = next(path for path in files(store) if path.name == f"{place[0]}-{place[1]}-{place[2]}.exr"
                     and (path.parent != files(store)[0].parent or key == KEY))
        right = next(path for path in files(store) if path != wrong)
        wrong.write_bytes(right.read_bytes())
        assert store.get(key, *place) is None
        (record,) = caplog.records
        assert "another batch than its name says" in record.getMessage()

    def test_what_cannot_be_set_aside_is_rendered_again_all_the_same(
            self, store: Store, caplog: pytest.LogCaptureFixture) -> None:
        store.put(KEY, 0, 0, 4, batch())
        (path,) = files(store)
        path.write_bytes(b"")
        (store.root / SET_ASIDE).touch()  # somebody's file
        np.testing.assert_array_equal(store.get_or_render(KEY, 0, 0, 4, batch).mean, batch().mean)
        assert "cannot be set aside" in caplog.records[0].getMessage()
        assert store.get(KEY, 0, 0, 4) is not None


class TestFullDisk:
    """One line that says what is full and what helps; nothing half-written; what was there stays."""

    def test_whichever_write_fails_nothing_is_left_of_it(self, store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
        store.put(KEY, 0, 0, 4, batch())
        before = sorted(store.root.rglob("*"))
        writes = [(Path, "write_text"), (Path, "write_bytes"), (os, "replace"), (Path, "mkdir")]
        for place, name in writes:
            with monkeypatch.context() as patch:
                patch.setattr(place, name, self.full)
                with pytest.raises(StoreError, match=r"the disk is full.*prune --keep") as raised:
                    store.put({**KEY, "more": name}, 1, 0, 4, batch(), scene="spheres")
            assert "\n" not in str(raised.value)
            assert not list(store.root.rglob(f"{PARTIAL_PREFIX}*"))
            assert [path for path in store.root.rglob("*.exr") if path not in before] == []
        store.put(KEY, 1, 0, 4, batch())
        assert store.get(KEY, 0, 0, 4) is not None and store.get(KEY, 1, 0, 4) is not None

    @staticmethod
    def full(*arguments: object, **options: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def test_a_file_that_may_not_grow_is_not_left_half_written(self, tmp_path: Path) -> None:
        """A real limit, in a process of its own: the batch would be larger."""
        program = ("import resource, sys; from tests.samples.test_store import KEY, batch; "
                   "from harness.samples.store import Store; from harness.errors import StoreError; "
                   "resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))\n"
                   "try: Store(sys.argv[1]).put(KEY, 0, 0, 4, batch(side=64))\n"
                   "except StoreError as error: print(error)")
        done = subprocess.run([sys.executable, "-c", program, str(tmp_path)], capture_output=True, text=True,
                              check=True, cwd=ROOT)
        assert "cannot be written (File too large)" in done.stdout and done.stdout.count("\n") == 1
        assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["key.json"]


class TestKills:
    """Whoever uses a store may be killed at any moment."""

    @pytest.mark.parametrize("seed", range(3))
    def test_no_moment_changes_a_number(self, tmp_path: Path, seed: int) -> None:
        """Twelve runs on one store, each killed at a random call, every other one while it writes; then one that ends.

        `python -m tests.support.kills` does it to a whole study, fifty times.
        """
        done = subprocess.run([sys.executable, "-m", "tests.support.kills", str(tmp_path), str(seed), "12"],
                              capture_output=True, text=True, check=True, cwd=ROOT)
        found = json.loads(done.stdout)
        assert found["signals"] == [signal.SIGKILL] * 12
        assert max(found["whole"]) > 0
        assert found["resumed"] == found["undisturbed"]
        # What the dead left half-written stays out of the way, and goes when it is old.
        killed = Store(tmp_path / "killed")
        assert all(one.batches == len(list(killed.root.glob(f"??/{one.key}/[!.]*.exr"))) for one in inventory(killed))
        torn = list(killed.root.rglob(f"{PARTIAL_PREFIX}*"))
        assert len([path for path in torn if path.suffix == ".exr"]) == found["torn"][-1]
        for path in torn:
            os.utime(path, (0, 0))
        prune(killed)
        assert not list(killed.root.rglob(f"{PARTIAL_PREFIX}*"))

    def test_two_at_once_give_the_numbers_of_one(self, tmp_path: Path) -> None:
        """Two processes on one store, which both begin with nothing."""
        program = ("import sys; from pathlib import Path; from tests.support.kills import draw; "
                   "print(draw(Path(sys.argv[1])))")
        running = [subprocess.Popen([sys.executable, "-c", program, str(tmp_path / folder)], stdout=subprocess.PIPE,
                                    text=True, cwd=ROOT) for folder in ("shared", "shared", "alone")]
        assert len({process.communicate()[0] for process in running}) == 1
        assert [process.returncode for process in running] == [0, 0, 0]
        assert all(store.get(NoiseRenderer().identity, 0, 128, 128) for store in [Store(tmp_path / "shared")])


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
