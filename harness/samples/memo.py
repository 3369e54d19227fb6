"""Results in the cache: read back where there are any, else made and kept."""

from __future__ import annotations

import hashlib
import logging
import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from harness.errors import StoreError
from harness.files import cache_dir, write_atomically
from harness.samples.keys import digest

Result = TypeVar("Result")
Warn = Callable[[str], None]
# Bytes of the SHA-256 that stands before what `remembered_bytes` keeps.
SEAL = 32
# What damaged files are called then.
ASIDE = ".damaged"
# Beside a result: how long it took to make, in seconds.
SECONDS_FILE = "seconds.txt"

_log = logging.getLogger(__name__)


def remembered(folder: Path, last: str, *, load: Callable[[Path], Result], make: Callable[[], Result],
               save: Callable[[Result, Path], None], warn: Warn, loss: str) -> tuple[Result, bool]:
    """The result that `folder` holds, or a new one, then kept there; and whether it was made now.

    `last`: the file that `save` writes last. One that `load` refuses with a StoreError is made again, of which `warn`
    is told in one line that ends in `loss`. What is new is read back, too, lest it differ in the last bits from what a
    later process reads, and all that is remembered of it be made twice.
    """
    if (folder / last).exists():
        try:
            found = load(folder)
            with suppress(OSError):
                os.utime(folder / last)  # what is pruned is what was not used for longest
            return found, False
        except StoreError as error:
            warn(f"{error.args[0].partition(';')[0]}; {loss}")
    began = time.perf_counter()
    made = make()
    took = time.perf_counter() - began
    save(made, folder)
    with suppress(StoreError), write_atomically(folder / SECONDS_FILE) as partial:
        partial.write_text(f"{took:.3f}\n", encoding="utf-8")
    return load(folder), True


def seconds_to_make(folder: Path) -> float | None:
    """Wall-clock seconds that the result in a folder took when it was made; None where that is not known."""
    try:
        return float((folder / SECONDS_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def remembered_bytes(kind: str, key: object, make: Callable[[], bytes]) -> bytes:
    """A file of some kilobytes, such as a figure: read back from the cache, else made and kept there.

    `kind` names its folder; `key`, a plain value (see `digest`), is all that the file depends on, the code too. One
    that is damaged is set aside and made again, and a cache that cannot be written costs only time.
    """
    path = cache_dir() / kind / digest(key, 24)
    with suppress(OSError):
        held = path.read_bytes()
        if hashlib.sha256(held[SEAL:]).digest() == held[:SEAL]:
            os.utime(path)
            return held[SEAL:]
        os.replace(path, path.with_name(path.name + ASIDE))
        _log.warning("%s: damaged; set aside as %s, and made again", path, path.name + ASIDE)
    content = make()
    with suppress(StoreError), write_atomically(path) as partial:
        partial.write_bytes(hashlib.sha256(content).digest() + content)
    return content
