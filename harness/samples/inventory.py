"""What a store holds, told to people: scene, estimator, samples, bytes, last use; and how it is verified and pruned."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from harness.files import PARTIAL_PREFIX
from harness.samples.keys import digest
from harness.samples.store import ABOUT_FILE, KEY_FILE, SET_ASIDE, Store

# Seconds after which whoever left a file half-written is taken for dead, and an empty folder for nobody's.
ABANDONED = 3600.0
# What is made of batches and read back where it was made before, by its folder in the cache; each file, or folder of
# files, in it is one that is made again where it went.
MADE = {"studies": "studies of a report", "coupled": "coupled comparisons of a report",
        "features": "features without and with, of a report", "exhibits": "the handout's errors",
        "figures": "figures of a report", "chapters": "chapters of a report", "pages": "pages of a report",
        "meshes": "meshes of displaced shapes"}
# Of these every change of the report's code leaves some behind that nobody asks for again; so many seconds later a
# report removes them.
PAGES, UNUSED = ("figures", "chapters", "pages"), 30 * 86400.0
# What a renderer's identity calls its way of drawing, in the order in which people say it.
_WORDS = ("strategy", "integrator", "command", "sampler")


@dataclass(frozen=True)
class Series:
    """The batches of one key: all that one renderer drew of one scene.

    `samples`: per pixel, of all batches and replicas together; `used`: seconds since 1970.
    """

    key: str
    scene: str
    estimator: str
    batches: int
    replicas: int
    samples: int
    bytes: int
    used: float


def inventory(store: Store) -> list[Series]:
    """Every series of a store, the last used first, and at the end what was set aside, if anything was."""
    found: dict[Path, list[tuple[float, int, Path]]] = {}
    for used, size, path in store.files():
        found.setdefault(path.parent, []).append((used, size, path))
    aside = found.pop(store.root / SET_ASIDE, [])
    series = sorted((_series(folder, files) for folder, files in found.items()), key=lambda one: -one.used)
    if aside:
        series.append(Series("", "", SET_ASIDE, len(aside), 0, 0, sum(size for _, size, _ in aside),
                             max(used for used, _, _ in aside)))
    return series


def inventory_of_made(cache: Path) -> list[Series]:
    """What the cache holds besides batches, a line for each kind that is there."""
    found = []
    for kind, name in MADE.items():
        items = list(_made(cache, kind))
        if items:
            found.append(Series(kind, "", name, len(items), 0, 0, sum(size for _, size, _ in items),
                                max(used for used, _, _ in items)))
    return found


def prune_made(cache: Path, *, keep: int | None = None, older: float | None = None,
               kinds: Iterable[str] = tuple(MADE)) -> int:
    """Remove of what was made of batches, or of some kinds of it, all that was not used for `older` seconds, then what
    was unused for longest until at most `keep` bytes are left; returns the bytes removed. It is made again when it is
    needed."""
    items = sorted(item for kind in kinds for item in _made(cache, kind))
    left = sum(size for _, size, _ in items)
    removed, now = 0, time.time()
    for used, size, path in items:
        if (keep is None or left - removed <= keep) and (older is None or now - used < older):
            continue
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
        removed += size
    return removed


def _made(cache: Path, kind: str) -> Iterator[tuple[float, int, Path]]:
    """(time of last use, bytes, path) of each file or folder of a kind, whatever other processes remove meanwhile."""
    with suppress(OSError):
        for path in (cache / kind).iterdir():
            with suppress(OSError):
                files = [each.stat() for each in (path.iterdir() if path.is_dir() else [path])]
                yield max((status.st_mtime for status in files), default=0.0), sum(
                    status.st_size for status in files), path


def _series(folder: Path, files: list[tuple[float, int, Path]]) -> Series:
    names = [path.name.split(".")[0].split("-") for _, _, path in files]
    whole = [[int(word) for word in words] for words in names if len(words) == 3 and all(map(str.isdigit, words))]
    return Series(folder.name, _read(folder / ABOUT_FILE).get("scene", ""), _estimator(_read(folder / KEY_FILE)),
                  len(whole), len({replica for replica, _, _ in whole}), sum(count for _, _, count in whole),
                  sum(size for _, size, _ in files), max(used for used, _, _ in files))


def _read(path: Path) -> dict[str, str]:
    """A flat mapping in JSON; empty where it is missing or damaged."""
    with suppress(OSError, ValueError):
        found = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(found, dict):
            return {str(name): str(value) for name, value in found.items()}
    return {}


def _estimator(key: Mapping[str, str]) -> str:
    """In words: `mixture sobol`, `mitsuba path`, `command myrt {scene} …`; what the key calls its renderer besides, if
    it is not our tracer."""
    renderer = key.get("renderer", "")
    words = [renderer if renderer != "glsl" else "", *(key.get(word, "") for word in _WORDS)]
    return " ".join(dict.fromkeys(filter(None, words)))


def verify(store: Store) -> Iterator[Path | None]:
    """Read every batch of a store: of each None, or the file, which was damaged or misplaced and is now set aside.

    Nothing counts as used by it. A key that does not belong to its folder is removed, and written again with the next
    batch.
    """
    for path in [path for _, _, path in store.files() if path.parent.name != SET_ASIDE]:
        if path.name.startswith(PARTIAL_PREFIX):
            continue
        key = path.with_name(KEY_FILE)
        if key.exists() and digest(_read(key)) != path.parent.name:
            key.unlink(missing_ok=True)
        yield path if store.read(path, use=False) is None and not path.exists() else None


def prune(store: Store, *, keep: int | None = None, older: float | None = None) -> int:
    """Remove what was not used for `older` seconds, then what was unused for longest until at most `keep` bytes are
    left, then what nobody needs: half-written files of the dead, empty folders. Returns the bytes removed."""
    now = time.time()
    removed = 0
    for left in [*store.root.glob(f"??/*/{PARTIAL_PREFIX}*"), *store.root.glob(f"{PARTIAL_PREFIX}*")]:
        with suppress(OSError):
            status = left.stat()
            if now - status.st_mtime > ABANDONED:
                left.unlink()
                removed += status.st_size
    removed += store.prune(store.size() if keep is None else keep, None if older is None else now - older)
    for folder in store.root.glob("??/*"):
        _remove_empty(folder, now)
    return removed


def _remove_empty(folder: Path, now: float) -> None:
    """A folder without batches, unless somebody may be about to write one."""
    with suppress(OSError):  # another process tidies, too, or has just written a batch
        if {path.name for path in folder.iterdir()} <= {KEY_FILE, ABOUT_FILE} and (
                now - folder.stat().st_mtime > ABANDONED):
            for name in (KEY_FILE, ABOUT_FILE):
                (folder / name).unlink(missing_ok=True)
            folder.rmdir()
            folder.parent.rmdir()
