"""Exhibits on disk: words and numbers in `exhibits.json`, arrays as float32 in `exhibits.npz` beside it."""

from __future__ import annotations

import dataclasses
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import StoreError
from harness.files import write_atomically
from harness.results import Exhibit, ExhibitImage, Plot, Series
from harness.samples import json

WORDS_FILE, ARRAYS_FILE = "exhibits.json", "exhibits.npz"


def save_exhibits(exhibits: Sequence[Exhibit], folder: str | Path) -> None:
    """Write exhibits to `folder` (made if missing); the words last, so that whoever finds them finds all."""
    arrays: dict[str, np.ndarray] = {}

    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            name = f"a{len(arrays)}"
            arrays[name] = value.astype(np.float32)
            return name
        if dataclasses.is_dataclass(value):
            return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
        return [plain(item) for item in value] if isinstance(value, tuple) else value

    words = [plain(exhibit) for exhibit in exhibits]
    with write_atomically(Path(folder) / ARRAYS_FILE) as partial:
        np.savez_compressed(partial, **arrays)  # type: ignore[arg-type]  # numpy's stub takes the names for options
    json.save(Path(folder) / WORDS_FILE, words)


def load_exhibits(folder: str | Path) -> tuple[Exhibit, ...]:
    """Read exhibits back, arrays rounded to float32; StoreError when a file is missing, damaged or something else."""
    path = Path(folder) / WORDS_FILE
    mend = "remove it and measure again"
    try:
        with np.load(path.with_name(ARRAYS_FILE)) as arrays:
            return json.load(path, lambda words: tuple(_exhibit(held, arrays) for held in words),
                             what="exhibits of the handout", mend=mend)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise StoreError(f"{path.with_name(ARRAYS_FILE)}: missing or damaged ({type(error).__name__}); {mend}"
                         ) from error


def _exhibit(held: dict[str, Any], arrays: Any) -> Exhibit:
    """An exhibit whose words name its arrays."""
    images = tuple(json.built(ExhibitImage, image, image=arrays[image["image"]]) for image in held["images"])
    plots = tuple(json.built(Plot, plot, series=tuple(
        json.built(Series, line, x=arrays[line["x"]], y=arrays[line["y"]]) for line in plot["series"]))
        for plot in held["plots"])
    return json.built(Exhibit, held, images=images, plots=plots)
