"""Exhibits on disk: words and numbers in `exhibits.json`, arrays as float32 in `exhibits.npz` beside it."""

from __future__ import annotations

import dataclasses
import json
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import StoreError
from harness.files import write_atomically
from harness.results import Exhibit, ExhibitImage, Finding, Plot, Series

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

    words = json.dumps([plain(exhibit) for exhibit in exhibits], indent=1, ensure_ascii=False)
    with write_atomically(Path(folder) / ARRAYS_FILE) as partial:
        np.savez_compressed(partial, **arrays)  # type: ignore[arg-type]  # numpy's stub takes the names for options
    with write_atomically(Path(folder) / WORDS_FILE) as partial:
        partial.write_text(words + "\n", encoding="utf-8")


def load_exhibits(folder: str | Path) -> tuple[Exhibit, ...]:
    """Read exhibits back, arrays rounded to float32; StoreError when a file is missing, damaged or something else."""
    path = Path(folder) / WORDS_FILE
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        with np.load(path.with_name(ARRAYS_FILE)) as arrays:
            return tuple(_exhibit(held, arrays) for held in content)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, EOFError, zipfile.BadZipFile) as error:
        raise StoreError(f"{path}: missing or damaged ({type(error).__name__}); remove it and measure again") from error


def _exhibit(held: dict[str, Any], arrays: Any) -> Exhibit:
    images = tuple(ExhibitImage(image["title"], arrays[image["image"]], image["unit"]) for image in held["images"])
    plots = tuple(Plot(plot["title"], plot["x_label"], plot["log"], tuple(
        Series(line["name"], line["ours"], arrays[line["x"]], arrays[line["y"]]) for line in plot["series"]))
        for plot in held["plots"])
    findings = tuple(Finding(**finding) for finding in held["findings"])
    return Exhibit(**{**held, "findings": findings, "images": images, "plots": plots})
