"""The batch store: rendered batches on disk, found again by the content that they depend on."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from harness.errors import HarnessError, StoreError
from harness.files import write_atomically
from harness.samples.estimate import Batch
from harness.samples.exr import read_batch, write_batch
from harness.samples.keys import digest
from harness.samples.spent import spent

# Samples per pixel of the longest batch; within what one Mitsuba pass can sum in float32 without visible rounding.
LONGEST_BATCH = 128
# A run of `LEAD_FACTOR` times as many samples or more does not keep the batches within its first `LEAD_IN`: six of the
# nine images of a run of 256, and an eighth of its work. Samples are numbered, so what is drawn again is the same; of
# renderers that do not repeat themselves bit for bit (see `Traits.repeats`) all are kept.
LEAD_IN, LEAD_FACTOR = 32, 8
# Bytes on disk beyond which the batches unused for longest are removed.
DEFAULT_LIMIT = 8 * 2**30
# A prune goes this far below the limit, so that the next batch does not start another.
PRUNE_TO = 0.9

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


def is_kept(start: int, count: int, samples: int) -> bool:
    """Whether a batch of a run of `samples` samples per pixel is worth its room; short runs keep all of theirs."""
    return samples < LEAD_FACTOR * LEAD_IN or start + count > LEAD_IN


class Store:
    """Batches in `root`, one EXR file each: `<2 digits>/<key>/<replica>-<start>-<count>.exr`; those that another
    process drew, and that go when they have been read, end in `.once.exr`.

    The key is a hash of a flat mapping of everything that a batch depends on besides replica and sample range; the
    mapping stands beside the batches as `key.json`. Files are replaced atomically, so any number of processes may
    share a store. When it outgrows `limit` bytes, the batches unused for longest are removed.
    """

    def __init__(self, root: str | Path, limit: int = DEFAULT_LIMIT) -> None:
        self.root = Path(root)
        self.limit = limit
        self._size: int | None = None  # as far as this process knows; counted at the first write

    def get(self, key: Mapping[str, str], replica: int, start: int, count: int) -> Batch | None:
        """The stored batch, or None. A damaged file is reported in one line, removed, and taken for absent."""
        return self._read(self._path(key, replica, start, count))

    def put(self, key: Mapping[str, str], replica: int, start: int, count: int, batch: Batch) -> None:
        """Store a batch. StoreError when it cannot be written; ValueError when it holds another number of samples."""
        if batch.samples != count:
            raise ValueError(f"expected a batch of {count} samples, found {batch.samples}")
        self._write(self._path(key, replica, start, count), key, replica, start, batch)

    def hold(self, key: Mapping[str, str], replica: int, start: int, count: int, render: Callable[[], Batch], *,
             keep: bool = True) -> None:
        """See that the batch is there for `get_or_render`: if not to `keep`, then until that has read it once."""
        if keep:
            self.get_or_render(key, replica, start, count, render)
        elif not self._once(key, replica, start, count).exists() and self.get(key, replica, start, count) is None:
            self._write(self._once(key, replica, start, count), key, replica, start, _compact(render()))

    @spent("store, writing")
    def _write(self, path: Path, key: Mapping[str, str], replica: int, start: int, batch: Batch) -> None:
        if not path.with_name("key.json").exists():
            with write_atomically(path.with_name("key.json")) as partial:
                partial.write_text(json.dumps(dict(key), indent=2, sort_keys=True, ensure_ascii=False) + "\n", "utf-8")
        write_batch(path, batch, {"replica": replica, "start": start, "spp": batch.samples}, compact=True)
        self._account(batch.mean.nbytes)

    def get_or_render(self, key: Mapping[str, str], replica: int, start: int, count: int,
                      render: Callable[[], Batch], *, keep: bool = True) -> Batch:
        """The stored batch, or the one that `render` returns, which is then stored if to `keep`.

        What is not to be kept may have been left by `hold`; it is read and removed. Either way the pixels are the same
        float32 numbers, so a run from a warm store repeats a cold one exactly.
        """
        batch = self.get(key, replica, start, count)
        if batch is None and not keep:
            batch = self._read(once := self._once(key, replica, start, count))
            _remove(once)
        if batch is None:
            batch = _compact(render())
            if keep:
                self.put(key, replica, start, count, batch)
        return batch

    def size(self) -> int:
        """Bytes that the batches take."""
        return sum(size for _, size, _ in self._files())

    def prune(self, limit: int) -> int:
        """Remove the batches unused for longest until at most `limit` bytes are left; returns the bytes removed."""
        files = sorted(self._files())
        left = sum(size for _, size, _ in files)
        removed = 0
        for _, size, path in files:
            if left - removed <= limit:
                break
            _remove(path)
            removed += size
        self._size = left - removed
        return removed

    def _path(self, key: Mapping[str, str], replica: int, start: int, count: int) -> Path:
        name = digest(dict(key))
        return self.root / name[:2] / name / f"{replica}-{start}-{count}.exr"

    def _once(self, key: Mapping[str, str], replica: int, start: int, count: int) -> Path:
        return self._path(key, replica, start, count).with_suffix(".once.exr")

    @spent("store, reading")
    def _read(self, path: Path) -> Batch | None:
        try:
            if not path.exists():
                return None
            batch = read_batch(path)
        except StoreError as error:
            if path.exists():  # else another process has just removed it
                _log.warning("%s; removed, its samples are rendered again", str(error).partition(";")[0])
                _remove(path)
            return None
        _touch(path)
        return batch

    def _account(self, written: int) -> None:
        """Count bytes just written (noise hardly compresses), and prune when the store has outgrown its limit."""
        self._size = self.size() if self._size is None else self._size + written
        if self._size > self.limit:
            removed = self.prune(int(PRUNE_TO * self.limit))
            _log.warning("%s: removed %.2g GiB of old batches to stay below %.2g GiB", self.root, removed / 2**30,
                         self.limit / 2**30)

    def _files(self) -> Iterator[tuple[float, int, Path]]:
        """(time of last use, bytes, path) of every batch, whatever other processes remove meanwhile.

        What a killed process left half-written counts too, and so goes the way of old batches.
        """
        for path in self.root.glob("??/*/*.exr"):
            try:
                status = path.stat()
            except FileNotFoundError:
                continue
            yield status.st_mtime, status.st_size, path


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
