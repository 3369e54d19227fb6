"""The batch store: rendered batches on disk, found again by the content that they depend on."""

from __future__ import annotations

import errno
import json
import logging
import os
import secrets
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from harness.errors import HarnessError, StoreError
from harness.files import PARTIAL_PREFIX, write_atomically
from harness.samples.estimate import Batch
from harness.samples.exr import read_batch, write_batch
from harness.samples.keys import digest
from harness.samples.spent import spent

# Samples per pixel of the longest batch; within what one Mitsuba pass can sum in float32 without visible rounding.
LONGEST_BATCH = 128
# A run of `LEAD_FACTOR` times as many samples or more does not keep the batches within its first `LEAD_IN`: four of the
# seven images of a run of 64, and an eighth of its work. To write one takes 7 ms, to draw one sample per pixel of a
# small film 1 ms. Samples are numbered, so what is drawn again is the same; of renderers that do not repeat themselves
# bit for bit (see `Traits.repeats`) all are kept.
LEAD_IN, LEAD_FACTOR = 8, 8
# Seconds per pixel that a batch took beyond which it is compressed: that costs 0.11 µs a pixel, and saves a third of
# the room.
COMPACT_FROM = 2.5e-6
# Bytes on disk beyond which the batches unused for longest are removed.
DEFAULT_LIMIT = 8 * 2**30
# A prune goes this far below the limit, so that the next batch does not start another.
PRUNE_TO = 0.9
# Part of the limit after whose writing the store is measured anew: other processes write to it, too.
MEASURED_EVERY = 1 / 64
# Beside the batches: the key that they share, for people, and which scene it is of.
KEY_FILE, ABOUT_FILE = "key.json", "about.json"
# Where files go that are no batches, or not those that their names say.
SET_ASIDE = "set-aside"

_log = logging.getLogger(__name__)


def schedule(samples: int) -> list[tuple[int, int]]:
    """Batches (start, count) of a run of `samples` samples per pixel: 1, 1, 2, 4, … 64, then 128 each.

    The first batches double what came before, so that each power of two up to 128 is a prefix of the run: the points
    of a convergence curve. The rule does not depend on the total, so a longer run begins with the batches of a
    shorter one and finds them in the store; only the last batch is cut to meet the total exactly. HarnessError for
    fewer than one sample.
    """
    if samples < 1:
        raise HarnessError(f"samples per pixel must be at least 1, found {samples}")
    batches = []
    start = 0
    while start < samples:
        count = min(max(start, 1), LONGEST_BATCH, samples - start)
        batches.append((start, count))
        start += count
    return batches


def portions(samples: int, *, prefixes: bool = True, repeats: bool = True) -> list[tuple[int, int, bool]]:
    """The batches (start, count) of a run of `samples` samples per pixel, and whether each is worth its room; short
    runs keep all of theirs.

    `prefixes`: whether anyone looks at what the run begins with; else a long run draws at once what it does not keep,
    in a seventh less time where films are small. `repeats`: as in `Traits`; else all are kept. HarnessError as
    `schedule`.
    """
    batches = schedule(samples)
    if not repeats or samples < LEAD_FACTOR * LEAD_IN:
        return [(start, count, True) for start, count in batches]
    if not prefixes:
        batches = [(0, LEAD_IN), *(batch for batch in batches if batch[0] >= LEAD_IN)]
    return [(start, count, start + count > LEAD_IN) for start, count in batches]


class Store:
    """Batches in `root`, one EXR file each: `<2 digits>/<key>/<replica>-<start>-<count>.exr`; those that another
    process drew, and that go when they have been read, end in `.once.exr`.

    The key is a hash of a flat mapping of everything that a batch depends on besides replica and sample range; the
    mapping stands beside the batches as `key.json`, and the scene's name in `about.json`. Files are replaced
    atomically, so any number of processes may share a store, and any of them may be killed. A file that is damaged, or
    that belongs elsewhere, is set aside. When the store outgrows `limit` bytes, the files unused for longest are
    removed.
    """

    def __init__(self, root: str | Path, limit: int = DEFAULT_LIMIT) -> None:
        self.root = Path(root)
        self.limit = limit
        self._size: int | None = None  # as far as this process knows; counted at the first write, and now and then
        self._written = 0  # since it was counted

    def get(self, key: Mapping[str, str], replica: int, start: int, count: int) -> Batch | None:
        """The stored batch, or None. A damaged file is reported in one line, set aside, and taken for absent."""
        return self.read(self._path(key, replica, start, count))

    def has(self, key: Mapping[str, str], replica: int, start: int, count: int) -> bool:
        """Is there a file of that batch? Whether it is sound, `get` finds out."""
        return self._path(key, replica, start, count).exists()

    def put(self, key: Mapping[str, str], replica: int, start: int, count: int, batch: Batch, *,
            scene: str = "") -> None:
        """Store a batch. StoreError when it cannot be written; ValueError when it holds another number of samples."""
        if batch.samples != count:
            raise ValueError(f"expected a batch of {count} samples, found {batch.samples}")
        self._write(self._path(key, replica, start, count), key, replica, start, batch, scene)

    def hold(self, key: Mapping[str, str], replica: int, start: int, count: int, render: Callable[[], Batch], *,
             keep: bool = True, scene: str = "") -> None:
        """See that the batch is there for `get_or_render`: if not to `keep`, then until that has read it once."""
        if keep:
            self.get_or_render(key, replica, start, count, render, scene=scene)
        elif not (once := self._once(key, replica, start, count)).exists() and self.get(
                key, replica, start, count) is None:
            self._write(once, key, replica, start, _compact(render()), scene)

    @spent("store, writing")
    def _write(self, path: Path, key: Mapping[str, str], replica: int, start: int, batch: Batch, scene: str) -> None:
        try:
            _write_once(path.with_name(KEY_FILE), dict(key))
            if scene:
                _write_once(path.with_name(ABOUT_FILE), {"scene": scene})
            write_batch(path, batch, {"key": path.parent.name, "replica": replica, "start": start,
                                      "spp": batch.samples}, compact=_is_dear(batch))
        except StoreError as error:
            if isinstance(error.__cause__, OSError) and error.__cause__.errno in (errno.ENOSPC, errno.EDQUOT):
                raise StoreError(f"{self.root}: the disk is full, and the store takes {self.size() / 2**30:.2g} GiB of "
                                 "it; free some space (`harness store prune --keep 1GB`), or set HARNESS_CACHE to a "
                                 "folder on another disk; the same command then goes on where it was") from error
            raise
        self._account(batch.mean.nbytes)

    def get_or_render(self, key: Mapping[str, str], replica: int, start: int, count: int,
                      render: Callable[[], Batch], *, keep: bool = True, scene: str = "") -> Batch:
        """The stored batch, or the one that `render` returns, which is then stored if to `keep`.

        What is not to be kept may have been left by `hold`; it is read and removed. Either way the pixels are the same
        float32 numbers, so a run from a warm store repeats a cold one exactly. `scene`: its name, for people.
        """
        batch = self.get(key, replica, start, count)
        if batch is None and not keep:
            batch = self.read(once := self._once(key, replica, start, count))
            _remove(once)
        if batch is None:
            batch = _compact(render())
            if keep:
                self.put(key, replica, start, count, batch, scene=scene)
        return batch

    def size(self) -> int:
        """Bytes that the batches take, and what was set aside."""
        return sum(size for _, size, _ in self.files())

    def prune(self, limit: int, unused_since: float | None = None) -> int:
        """Remove the files unused for longest until at most `limit` bytes are left, and all that were not used since a
        time (seconds since 1970); returns the bytes removed."""
        files = sorted(self.files())
        left = sum(size for _, size, _ in files)
        removed = 0
        for used, size, path in files:
            if left - removed <= limit and (unused_since is None or used >= unused_since):
                break
            _remove(path)
            removed += size
        self._size, self._written = left - removed, 0
        return removed

    @contextmanager
    def mark(self) -> Iterator[str]:
        """A word that `sees` knows wherever this very store is meant, as long as the block lasts."""
        name = f"{PARTIAL_PREFIX}{os.getpid()}-{secrets.token_hex(8)}.mark"
        path = self.root / name
        with write_atomically(path) as partial:
            partial.touch()
        try:
            yield name
        finally:
            _remove(path)

    def sees(self, mark: str) -> bool:
        """Is this the store, on the same disk, that gave the mark?"""
        return (self.root / mark).exists()

    def files(self) -> Iterator[tuple[float, int, Path]]:
        """(time of last use, bytes, path) of every batch and of all that was set aside, whatever other processes remove
        meanwhile.

        What a killed process left half-written counts too, and so goes the way of old batches.
        """
        for pattern in ("??/*/*.exr", f"{SET_ASIDE}/*"):
            for path in self.root.glob(pattern):
                try:
                    status = path.stat()
                except FileNotFoundError:
                    continue
                yield status.st_mtime, status.st_size, path

    @spent("store, reading")
    def read(self, path: Path, *, use: bool = True) -> Batch | None:
        """The batch of a file of this store, or None; a damaged one is reported in one line and set aside. `use`: note
        that it was used."""
        try:
            if not path.exists():
                return None
            batch = read_batch(path, _named(path))
        except StoreError as error:
            if path.exists():  # else another process has just set it aside
                self._set_aside(path, str(error).partition(";")[0])
            return None
        if use:
            _touch(path)
        return batch

    def _set_aside(self, path: Path, reason: str) -> None:
        """Out of the way, but there to be looked at; pruned as batches are."""
        place = self.root / SET_ASIDE / f"{path.parent.name[:16]}-{path.stem}-{secrets.token_hex(4)}{path.suffix}"
        try:
            place.parent.mkdir(exist_ok=True)
            os.replace(path, place)
        except OSError as error:
            _log.warning("%s; it cannot be set aside (%s), and its samples are rendered again", reason,
                         error.strerror or error)
        else:
            _log.warning("%s; set aside as %s, its samples are rendered again", reason, place.relative_to(self.root))

    def _path(self, key: Mapping[str, str], replica: int, start: int, count: int) -> Path:
        name = _name(tuple(sorted(key.items())))
        return self.root / name[:2] / name / f"{replica}-{start}-{count}.exr"

    def _once(self, key: Mapping[str, str], replica: int, start: int, count: int) -> Path:
        return self._path(key, replica, start, count).with_suffix(".once.exr")

    def _account(self, written: int) -> None:
        """Count bytes just written (noise hardly compresses), and prune when the store has outgrown its limit."""
        self._written += written
        if self._size is None or self._written > MEASURED_EVERY * self.limit:
            self._size, self._written = self.size(), 0
        if self._size + self._written > self.limit:
            removed = self.prune(int(PRUNE_TO * self.limit))
            _log.warning("%s: removed %.2g GiB of old batches to stay below %.2g GiB", self.root, removed / 2**30,
                         self.limit / 2**30)


@lru_cache(maxsize=256)
def _name(key: tuple[tuple[str, str], ...]) -> str:
    """The digest of a key, which every batch of a run asks for."""
    return digest(dict(key))


def _write_once(path: Path, value: Mapping[str, str]) -> None:
    """A small mapping as JSON, where it is not there yet."""
    if not path.exists():
        with write_atomically(path) as partial:
            partial.write_text(json.dumps(value, indent=2, sort_keys=True, ensure_ascii=False) + "\n", "utf-8")


def _named(path: Path) -> dict[str, str]:
    """What the metadata of a batch must say by the file's name and place; empty where the name is none of ours."""
    words = path.name.split(".")[0].split("-")
    if len(words) != 3:
        return {}
    return {"key": path.parent.name, **dict(zip(("replica", "start", "spp"), words, strict=True))}


def _is_dear(batch: Batch) -> bool:
    """Whether drawing it took so long that compressing adds little; yes where nobody measured."""
    height, width, _ = batch.mean.shape
    return not batch.cost.seconds < COMPACT_FROM * height * width


def _compact(batch: Batch) -> Batch:
    """As it is stored."""
    return replace(batch, mean=batch.mean.astype(np.float32))


def _touch(path: Path) -> None:
    """Note that a file was used; a read-only store, or a file removed meanwhile, only loses the note."""
    try:
        os.utime(path)
    except OSError:
        _log.debug("%s: last use could not be noted", path)


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        _log.warning("%s: cannot be removed (%s)", path, error.strerror or error)
