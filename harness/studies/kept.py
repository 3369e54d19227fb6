"""Studies in a folder: one by itself, or those of a product, each in a folder of its own beside the table of all."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from harness.errors import StoreError
from harness.results import StudyResult
from harness.samples import json
from harness.studies.parameters import Axes
from harness.studies.product import StudyProduct, without_pixels
from harness.studies.storage import discard_study, load_study, save_study
from harness.studies.table import PARQUET_FILE, TABLE_FILE, write_csv, write_parquet

PRODUCT_FILE = "product.json"
FORMAT = 1
# Characters of a folder's name, and what is kept of longer ones.
LONGEST, KEPT = 120, 100
_MEND = "remove it and run the study again"


class Kept:
    """A folder that takes the studies of a product as they come; `product`: several, so that each has a folder."""

    def __init__(self, folder: str | Path, *, product: bool) -> None:
        self.folder, self.product = Path(folder), product
        self._names: list[str] = []

    def add(self, result: StudyResult) -> None:
        """Write one study. StoreError when it cannot be written."""
        if not self.product:
            save_study(result, self.folder)
            (self.folder / PRODUCT_FILE).unlink(missing_ok=True)
            return
        name = folder_name(result)
        save_study(result, self.folder / name)
        self._names.append(name)

    def finish(self, product: StudyProduct) -> None:
        """Write what all have together; studies that a product before had here, and this one has not, go."""
        if self.product:
            before = _listed(self.folder)
            json.save(self.folder / PRODUCT_FILE, {"format": FORMAT, "axes": product.axes, "studies": self._names})
            for name in set(before) - set(self._names):
                discard_study(self.folder / name)
                with suppress(OSError):
                    (self.folder / name).rmdir()
            discard_study(self.folder)
        rows = list(product.records())
        write_csv(rows, self.folder / TABLE_FILE)
        write_parquet(rows, self.folder / PARQUET_FILE)


def load_studies(folder: str | Path) -> StudyProduct:
    """The product, or the single study, that a folder holds; without images. StoreError, one line, where it is none."""
    folder = Path(folder)
    path = folder / PRODUCT_FILE
    if not path.is_file():
        result = load_study(folder)
        axes = tuple((name, (value,)) for name, value in result.strategies[0].parameters)
        return StudyProduct(axes, (without_pixels(result),))

    def read(content: Any) -> StudyProduct:
        if content.get("format") != FORMAT:
            raise StoreError(f"{path}: format {content.get('format')} of a product of studies, this version reads "
                             f"{FORMAT}; {_MEND}")
        axes: Axes = json.converted(tuple[tuple[str, tuple[str, ...]], ...], content["axes"])
        names = json.converted(tuple[str, ...], content["studies"])
        if any(Path(name).name != name for name in names):
            raise ValueError("a study that lies elsewhere")
        return StudyProduct(axes, tuple(without_pixels(load_study(folder / name)) for name in names))

    return json.load(path, read, what="a product of studies", mend=_MEND)


def folder_name(result: StudyResult) -> str:
    """`ball_alpha=10_aperture=0.1`: what a study of a product is called on disk: always the same, never another's."""
    scene, parameters = result.cell
    plain = "_".join([scene, *(f"{name}={value}" for name, value in parameters)])
    name = re.sub(r"[^A-Za-z0-9_.=+-]", "_", plain)
    if name == plain and len(name) <= LONGEST and not name.startswith("."):
        return name
    return f"{name[:KEPT].lstrip('.')}.{hashlib.sha256(repr(result.cell).encode()).hexdigest()[:8]}"


def _listed(folder: Path) -> list[str]:
    """The folders of a product that was here before; none where there is none that can be read."""
    def read(content: Mapping[str, Any]) -> list[str]:
        return [str(name) for name in content["studies"] if Path(str(name)).name == str(name)]

    try:
        return json.load(folder / PRODUCT_FILE, read, what="a product of studies", mend=_MEND)
    except StoreError:
        return []
