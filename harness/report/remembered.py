"""Chapters that were set before: read back where all that they are made of is the same.

A scene's chapter takes half a second of CPU time, most of it for compressing pictures, and a report has twenty.
"""

from __future__ import annotations

import io
import pickle
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from importlib import metadata
from typing import Any
from weakref import WeakKeyDictionary

from harness.report import blocks, pixels
from harness.report.blocks import Chapter
from harness.report.texts import FOLDER
from harness.results import StudyResult
from harness.samples.keys import code_digest, digest, folder_digest
from harness.samples.memo import remembered_bytes

# Packages that draw, compress and compute what chapters hold.
PACKAGES = ("numpy", "scipy", "matplotlib", "pillow", "flip-evaluator", "scikit-image")
_digests: WeakKeyDictionary[StudyResult, str] = WeakKeyDictionary()


def remembered_chapters(make: Callable[[], Iterable[Chapter]], module: str, *of: object) -> Sequence[Chapter]:
    """The chapters that `make` returns, or those that it returned when they were made of the same before.

    `module`: where they are made, whose code counts, with all that it imports. `of`: all that they depend on besides,
    as `digest` takes it; studies by every number of theirs. The report's texts always count.
    """
    key = [code_digest(module, __name__), folder_digest(FOLDER, ".toml"), _versions(), [_told(each) for each in of]]
    content = remembered_bytes("chapters", key, lambda: pickle.dumps(list(make()), pickle.HIGHEST_PROTOCOL))
    found: Sequence[Chapter] = _Unpickler(io.BytesIO(content)).load()
    return found


def study_digest(result: StudyResult) -> str:
    """The digest of all that a study holds; computed once, for a hundred images are read for it."""
    found = _digests.get(result)
    if found is None:
        found = _digests[result] = digest(result)
    return found


def _told(value: object) -> object:
    if isinstance(value, list | tuple):
        return [_told(each) for each in value]
    return study_digest(value) if isinstance(value, StudyResult) else value


@cache
def _versions() -> dict[str, str]:
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    return {"python": python, **{name: metadata.version(name) for name in PACKAGES}}


class _Unpickler(pickle.Unpickler):
    """Of blocks, and of nothing else that a file might name: whoever can write to the cache runs no code by it."""

    def find_class(self, module: str, name: str) -> Any:
        for room in (blocks, pixels):
            found = getattr(room, name, None)
            if module == room.__name__ and isinstance(found, type) and found.__module__ == module:
                return found
        raise pickle.UnpicklingError(f"a chapter holds no {module}.{name}")
