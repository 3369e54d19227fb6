"""Study results on disk: one folder a study, its table and its verdicts in `study.json`, images as EXR beside it."""

from __future__ import annotations

import dataclasses
import hashlib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness import metrics
from harness.errors import StoreError
from harness.results import REJECTED, SECONDS, Record, StrategyResult, StudyResult
from harness.samples import json
from harness.samples.estimate import Estimate
from harness.samples.exr import read_estimate, write_estimate
from harness.stats.channels import CHANNELS

STUDY_FILE = "study.json"
# Raised when files written before can no longer be read; 1 no tiles, 2 a field a metric, 3 no device, 4 no table,
# 5 no seconds of each replica.
FORMAT = 6
COLUMNS = [field.name for field in dataclasses.fields(Record)]
# What JSON may hold in a column; numbers that are not finite are text there.
KINDS: dict[str, set[type]] = {
    "scene": {str}, "parameters": {list}, "estimator": {str}, "replica": {int, type(None)}, "samples": {int},
    "quantity": {str}, "channel": {str}, "value": {float, int, str}, "low": {float, int, str, type(None)},
    "high": {float, int, str, type(None)}, "n": {int}, "device": {str}}

# `_image_name` makes these; files of other names in the folder are left alone.
_IMAGE = re.compile(r"[a-z0-9_-]+\.[0-9a-f]{12}\.exr")
_MEND = "remove it and run the study again"


def save_study(result: StudyResult, folder: str | Path) -> None:
    """Write a study to `folder` (made if missing), images as float32; StoreError when it cannot be written.

    Images are named by their content and `study.json` is replaced last, so that a reader finds the old study or the
    new one, whole, whenever the writer is interrupted. Images that no study names any more are then removed.
    """
    folder = Path(folder)
    images = {"reference": result.reference, **{s.strategy: s.estimate for s in result.strategies}}
    names = {}
    for role, estimate in images.items():
        names[role] = _image_name(role, estimate)
        path = folder / names[role]
        write_estimate(path, estimate, {"scene": result.scene, "scene_hash": result.scene_hash, "role": role,
                                        "spp": estimate.samples})
    words = {field.name: getattr(result, field.name) for field in dataclasses.fields(result)
             if field.name not in ("reference", "strategies")}
    strategies = [{field.name: getattr(strategy, field.name) for field in dataclasses.fields(strategy)
                   if field.name not in ("measured", "estimate")} for strategy in result.strategies]
    rows = [row for strategy in result.strategies for row in strategy.measured]
    json.save(folder / STUDY_FILE, {"format": FORMAT, **words, "strategies": strategies, "images": names,
                                    "table": _table(rows)}, indent=None)
    for path in folder.iterdir():
        if _IMAGE.fullmatch(path.name) and path.name not in names.values():
            path.unlink(missing_ok=True)


def load_study(folder: str | Path) -> StudyResult:
    """Read a study back; equal to what was saved but for images rounded to float32.

    StoreError, one line, when a file is missing, truncated, damaged, or not what `save_study` writes.
    """
    folder = Path(folder)
    path = folder / STUDY_FILE

    def read(content: Any) -> StudyResult:
        found = content.get("format") if isinstance(content, dict) else None
        if found != FORMAT:
            raise StoreError(f"{path}: format {found} of a study, this version reads {FORMAT}; {_MEND}")
        return _study(folder, content)

    return json.load(path, read, what="a study", mend=_MEND, missing="no such study; run 'harness study' first")


def discard_study(folder: str | Path) -> None:
    """Remove a study and its images from a folder, and nothing else that lies there."""
    folder = Path(folder)
    if not (folder / STUDY_FILE).is_file():
        return
    (folder / STUDY_FILE).unlink(missing_ok=True)
    for path in folder.iterdir():
        if _IMAGE.fullmatch(path.name):
            path.unlink(missing_ok=True)


def _image_name(role: str, estimate: Estimate) -> str:
    digest = hashlib.sha256()
    for array in (estimate.mean, estimate.variance, estimate.image_mean, estimate.image_variance):
        digest.update(np.ascontiguousarray(array).tobytes())
    facts = (estimate.samples, estimate.batches, estimate.rejected, estimate.cost)
    digest.update(repr(facts).encode())
    return f"{re.sub(r'[^a-z0-9_-]', '_', role.lower())}.{digest.hexdigest()[:12]}.exr"


def _study(folder: Path, content: Mapping[str, Any]) -> StudyResult:
    images: Mapping[str, str] = content["images"]

    def image(role: str) -> Estimate:
        name = images[role]
        if not _IMAGE.fullmatch(name):
            raise ValueError(f"image name {name!r}")
        estimate, metadata = read_estimate(folder / name)
        if metadata.get("scene_hash") != content["scene_hash"] or metadata.get("role") != role:
            raise StoreError(f"{folder / name}: belongs to another study; {_MEND}")
        return estimate

    rows = _rows(content["table"])
    strategies = tuple(_strategy(held, rows, image(held["strategy"])) for held in content["strategies"])
    if not strategies:
        raise ValueError("no strategies")
    return json.built(StudyResult, content, strategies=strategies, reference=image("reference"))


def _strategy(held: Mapping[str, Any], rows: Sequence[Record], estimate: Estimate) -> StrategyResult:
    """A strategy; ValueError where its rows are not what this version measures."""
    name = held["strategy"]
    own = tuple(row for row in rows if row.estimator == name)
    found = json.built(StrategyResult, held, measured=own, estimate=estimate)
    known = {metric.name: metric.at_prefixes for metric in metrics.METRICS}
    if {**dict.fromkeys(found.curves, True), **dict.fromkeys(found.scores, False)} != known:  # before one was added
        raise ValueError(f"{name}: metrics {', '.join((*found.curves, *found.scores))}; this version measures "
                         f"{', '.join(known)}")
    shapes = {name: curve.shape for name, curve in found.curves.items()}
    if len(set(shapes.values())) != 1 or shapes["rmse"][1:] != found.spp.shape:
        raise ValueError(f"{name}: curves of shapes {shapes} over {found.spp.size} prefixes")
    if [row.quantity for row in own[-2:]] != [SECONDS, REJECTED]:
        raise ValueError(f"{name}: rows without {SECONDS} and {REJECTED} at their end")
    verdict = found.verdict
    if any(values.shape != (4,) for values in (verdict.error, verdict.low, verdict.high, verdict.dof,
                                               verdict.smallest_detectable)):
        raise ValueError(f"{name}: a verdict without four channels")
    if any(tiles.z.ndim != 2 or tiles.channel not in CHANNELS for tiles in (found.tiles.coarse, found.tiles.fine)):
        raise ValueError(f"{name}: tiles without a map, or of an unknown channel")
    return found


def _table(rows: Sequence[Record]) -> dict[str, Any]:
    """Records by column: `same` what all rows share, `columns` the others, a list each."""
    columns = {name: [getattr(row, name) for row in rows] for name in COLUMNS}
    same = {name: values[0] for name, values in columns.items() if all(value == values[0] for value in values)}
    return {"same": same, "columns": {name: values for name, values in columns.items() if name not in same}}


def _rows(table: Mapping[str, Any]) -> tuple[Record, ...]:
    """The records of a table; ValueError for other columns, or values of other types."""
    same, columns = table["same"], table["columns"]
    lengths = {len(values) for values in columns.values()}
    if {*same, *columns} != {*COLUMNS} or len(lengths) != 1:
        raise ValueError(f"a table of the columns {', '.join((*same, *columns))}, of lengths {sorted(lengths)}")
    found = {**{name: [value] * min(lengths) for name, value in same.items()}, **columns}
    for name, kinds in KINDS.items():
        if other := {*map(type, found[name])} - kinds:
            raise ValueError(f"a column '{name}' that holds {other.pop().__name__}")
    for name in ("value", "low", "high"):
        found[name] = [None if value is None else float(value) for value in found[name]]  # 'nan' and 'inf' as well
    found["parameters"] = [tuple((str(name), str(given)) for name, given in pairs) for pairs in found["parameters"]]
    return tuple(map(Record, *(found[name] for name in COLUMNS)))
