"""Records that hold one image each, as a file: their words as JSON, the images as float32."""

from __future__ import annotations

import dataclasses
import zipfile
from collections.abc import Sequence
from json import dumps, loads
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from harness.errors import StoreError
from harness.files import write_atomically
from harness.samples import json

Record = TypeVar("Record")


def save_pictured(path: Path, records: Sequence[Any], picture: str) -> None:
    """Write dataclasses, of which the field `picture` is an array of any shape. StoreError where that cannot be."""
    images = {f"image{number}": getattr(each, picture).astype(np.float32) for number, each in enumerate(records)}
    words = [{field.name: getattr(each, field.name) for field in dataclasses.fields(each) if field.name != picture}
             for each in records]
    with write_atomically(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, words=np.array(dumps(json.plain(words))), **images)


def load_pictured(path: Path, kind: type[Record], picture: str, mend: str) -> tuple[Record, ...]:
    """What `save_pictured` wrote of dataclasses of one kind, images float32. StoreError, with `mend` as what to do,
    where the file is missing, damaged or something else."""
    try:
        with np.load(path) as held:
            return tuple(json.built(kind, words, **{picture: held[f"image{number}"]})
                         for number, words in enumerate(loads(str(held["words"]))))
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise StoreError(f"{path}: missing or damaged ({type(error).__name__}); {mend}") from error
