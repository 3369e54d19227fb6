"""What a store is said to hold, how it is verified, and how room is made."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.files import PARTIAL_PREFIX
from harness.samples.estimate import Batch
from harness.samples.inventory import ABANDONED, inventory, inventory_of_made, prune, prune_made, verify
from harness.samples.store import ABOUT_FILE, KEY_FILE, SET_ASIDE, Store

OURS = {"renderer": "glsl", "scene": "0123", "strategy": "mixture", "sampler": "sobol"}
THEIRS = {"renderer": "mitsuba", "scene": "4567", "integrator": "path"}
DAY = 86400.0


def batch(samples: int) -> Batch:
    return Batch(np.random.default_rng(samples).random((8, 8, 3)).astype(np.float32), samples)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """Two replicas of ours, the older ten days old, and one of Mitsuba's, which is thirty days old."""
    store = Store(tmp_path / "store")
    for key, replica, start, count, scene in ((OURS, 0, 0, 64, "spheres"), (OURS, 1, 0, 64, "spheres"),
                                              (OURS, 1, 64, 64, "spheres"), (THEIRS, 0, 0, 128, "")):
        store.put(key, replica, start, count, batch(count), scene=scene)
    for pattern, days in (("0-0-64", 10), ("0-0-128", 30)):
        (path,) = store.root.glob(f"*/*/{pattern}.exr")
        os.utime(path, (time.time() - days * DAY,) * 2)
    return store


def names(store: Store) -> list[str]:
    return sorted(path.name for path in store.root.glob("??/*/*.exr"))


class TestInventory:
    """One line a series."""

    def test_tells_scene_estimator_samples_bytes_and_last_use(self, store: Store) -> None:
        ours, theirs = inventory(store)
        assert (ours.scene, ours.estimator, ours.replicas, ours.batches, ours.samples) == (
            "spheres", "mixture sobol", 2, 3, 192)
        assert (theirs.scene, theirs.estimator, theirs.samples) == ("", "mitsuba path", 128)
        assert ours.bytes + theirs.bytes == store.size()
        assert ours.used > theirs.used + 29 * DAY

    def test_counts_no_half_written_file_as_a_batch(self, store: Store) -> None:
        folder = next(store.root.glob("??/*/0-0-128.exr")).parent
        (folder / f"{PARTIAL_PREFIX}1-ab.exr").write_bytes(b"half")
        theirs = next(one for one in inventory(store) if one.estimator == "mitsuba path")
        assert theirs.batches == 1

    def test_tells_what_it_can_where_a_key_is_damaged(self, store: Store) -> None:
        folder = next(store.root.glob("??/*/0-0-128.exr")).parent
        (folder / KEY_FILE).write_text("{")
        assert [one.estimator for one in inventory(store)] == ["mixture sobol", ""]

    def test_tells_what_was_set_aside(self, store: Store) -> None:
        next(store.root.glob("??/*/0-0-128.exr")).write_bytes(b"not an image")
        assert store.get(THEIRS, 0, 0, 128) is None
        last = inventory(store)[-1]
        assert (last.estimator, last.batches, last.bytes) == (SET_ASIDE, 1, 12)

    def test_of_nothing_is_empty(self, tmp_path: Path) -> None:
        assert inventory(Store(tmp_path / "none")) == []


class TestVerify:
    """Every batch is read."""

    def test_a_sound_store_is_sound_and_counts_as_unused(self, store: Store) -> None:
        before = inventory(store)
        assert list(verify(store)) == [None] * 4
        assert inventory(store) == before

    def test_damaged_and_misplaced_files_are_set_aside(self, store: Store) -> None:
        damaged = next(store.root.glob("??/*/0-0-64.exr"))
        damaged.write_bytes(damaged.read_bytes()[:-8])
        misplaced = next(store.root.glob("??/*/1-0-64.exr"))
        misplaced.write_bytes(misplaced.with_name("1-64-64.exr").read_bytes())
        assert {path for path in verify(store) if path} == {damaged, misplaced}
        assert len(list((store.root / SET_ASIDE).iterdir())) == 2
        assert list(verify(store)) == [None] * 2

    def test_another_folders_key_is_written_again(self, store: Store) -> None:
        folder = next(store.root.glob("??/*/0-0-128.exr")).parent
        (folder / KEY_FILE).write_text('{"renderer": "glsl"}')
        assert list(verify(store)) == [None] * 4
        store.put(THEIRS, 1, 0, 128, batch(128))
        assert inventory(store)[0].estimator == "mitsuba path"


class TestPrune:
    """The oldest first."""

    def test_by_age(self, store: Store) -> None:
        size = store.size()
        removed = prune(store, older=20 * DAY)
        assert names(store) == ["0-0-64.exr", "1-0-64.exr", "1-64-64.exr"]
        assert removed == size - store.size() > 0
        prune(store, older=5 * DAY)
        assert names(store) == ["1-0-64.exr", "1-64-64.exr"]

    def test_by_room(self, store: Store) -> None:
        prune(store, keep=store.size() - 1)
        assert names(store) == ["0-0-64.exr", "1-0-64.exr", "1-64-64.exr"]
        assert prune(store, keep=store.size()) == 0

    def test_by_both(self, store: Store) -> None:
        (newest,) = store.root.glob("??/*/1-64-64.exr")
        os.utime(newest, (time.time() + 1,) * 2)
        prune(store, older=20 * DAY, keep=newest.stat().st_size)
        assert names(store) == ["1-64-64.exr"]

    def test_what_the_dead_left_goes_and_what_is_being_written_stays(self, store: Store) -> None:
        folder = next(store.root.glob("??/*/0-0-128.exr")).parent
        dead, alive = folder / f"{PARTIAL_PREFIX}1-ab.exr", folder / f"{PARTIAL_PREFIX}2-cd.exr"
        mark = store.root / f"{PARTIAL_PREFIX}1-ef.mark"
        for path in (dead, alive, mark):
            path.write_bytes(b"half")
        for path in (dead, mark):
            os.utime(path, (time.time() - 2 * ABANDONED,) * 2)
        assert prune(store) == 8
        assert (dead.exists(), alive.exists(), mark.exists()) == (False, True, False)

    def test_empty_folders_go_unless_they_are_new(self, store: Store) -> None:
        folders = sorted({path.parent for path in store.root.glob("??/*/*.exr")})
        prune(store, keep=0)
        assert sorted(store.root.glob("??/*")) == folders, "somebody may be about to write there"
        os.utime(folders[0], (time.time() - 2 * ABANDONED,) * 2)
        prune(store, keep=0)
        assert list(store.root.glob("??/*")) == folders[1:]
        assert not (folders[0] / ABOUT_FILE).exists()


class TestMade:
    """What is made of batches: figures in files, studies in folders."""

    @pytest.fixture
    def cache(self, tmp_path: Path) -> Path:
        """Two figures, one of them twenty days old, and a study of two files, ten days old."""
        for name, size, days in (("figures/new", 10, 0), ("figures/old", 20, 20), ("studies/a/study.json", 30, 10),
                                 ("studies/a/reference.exr", 40, 15), ("batches/aa/b/0-0-1.exr", 50, 99)):
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(b"x" * size)
            os.utime(path, (time.time() - days * DAY,) * 2)
        return tmp_path

    def test_is_told_a_line_a_kind(self, cache: Path) -> None:
        studies, figures = inventory_of_made(cache)
        assert (studies.estimator, studies.batches, studies.bytes) == ("studies of a report", 1, 70)
        assert (figures.key, figures.batches, figures.bytes) == ("figures", 2, 30)
        assert figures.used > studies.used + 9 * DAY

    @pytest.mark.parametrize(("options", "removed", "left"), [
        ({"older": 30 * DAY}, 0, ["figures/new", "figures/old", "studies/a"]),
        ({"older": 12 * DAY}, 20, ["figures/new", "studies/a"]),
        ({"keep": 80}, 20, ["figures/new", "studies/a"]),
        ({"keep": 79}, 90, ["figures/new"]),
        ({"keep": 0}, 100, []),
        ({"older": 5 * DAY, "kinds": ("figures",)}, 20, ["figures/new", "studies/a"]),
    ])
    def test_goes_by_last_use_whole_folders_at_a_time_and_no_batch(
        self, cache: Path, options: dict[str, Any], removed: int, left: list[str],
    ) -> None:
        assert prune_made(cache, **options) == removed
        assert sorted(str(path.relative_to(cache)) for kind in ("figures", "studies")
                      for path in (cache / kind).iterdir()) == left
        assert (cache / "batches/aa/b/0-0-1.exr").exists()
