"""Study results on disk: one folder a study, numbers in `study.json`, images as EXR beside it."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from harness import metrics
from harness.errors import StoreError
from harness.files import write_atomically
from harness.results import StrategyResult, StudyResult
from harness.samples.estimate import Estimate
from harness.samples.exr import read_estimate, write_estimate
from harness.stats.bias import MeanErrorVerdict, Outcome
from harness.stats.channels import CHANNELS
from harness.stats.convergence import Slope
from harness.stats.findings import TileFinding, Tiles

STUDY_FILE = "study.json"
FORMAT = 4  # raised when files written before can no longer be read; 1 no tiles, 2 a field a metric, 3 no device

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
    content = {"format": FORMAT, **_plain(result), "images": names}
    with write_atomically(folder / STUDY_FILE) as partial:
        partial.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    for path in folder.iterdir():
        if _IMAGE.fullmatch(path.name) and path.name not in names.values():
            path.unlink(missing_ok=True)


def load_study(folder: str | Path) -> StudyResult:
    """Read a study back; equal to what was saved but for images rounded to float32.

    StoreError, one line, when a file is missing, truncated, damaged, or not what `save_study` writes.
    """
    folder = Path(folder)
    path = folder / STUDY_FILE
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise StoreError(f"{path}: no such study; run 'harness study' first") from error
    except OSError as error:
        raise StoreError(f"{path}: cannot be read ({error.strerror}); name the folder of a saved study") from error
    except ValueError as error:  # malformed JSON, or not UTF-8
        raise StoreError(f"{path}: truncated or damaged; {_MEND}") from error
    found = content.get("format") if isinstance(content, dict) else None
    if found != FORMAT:
        raise StoreError(f"{path}: format {found} of a study, this version reads {FORMAT}; {_MEND}")
    try:
        return _study(folder, content)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise StoreError(f"{path}: not a study ({type(error).__name__}: {error}); {_MEND}") from error


def _image_name(role: str, estimate: Estimate) -> str:
    digest = hashlib.sha256()
    for array in (estimate.mean, estimate.variance, estimate.image_mean, estimate.image_variance):
        digest.update(np.ascontiguousarray(array).tobytes())
    facts = (estimate.samples, estimate.batches, estimate.rejected, estimate.cost)
    digest.update(repr(facts).encode())
    return f"{re.sub(r'[^a-z0-9_-]', '_', role.lower())}.{digest.hexdigest()[:12]}.exr"


def _plain(value: object) -> Any:
    """Dataclasses, arrays and numbers as JSON values; images are left out, numbers that are not finite become text."""
    if isinstance(value, Estimate):
        return None
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        held = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        return {name: _plain(each) for name, each in held.items() if not isinstance(each, Estimate)}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(name): _plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)  # 'nan', 'inf', '-inf': JSON has no numbers for them, and float() reads them back
    return value


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

    strategies = tuple(_strategy(held, image(held["strategy"])) for held in content["strategies"])
    if not strategies:
        raise ValueError("no strategies")
    return StudyResult(
        scene=str(content["scene"]), description=str(content["description"]), scene_hash=str(content["scene_hash"]),
        exposure=float(content["exposure"]), reference=image("reference"),
        reference_kind=str(content["reference_kind"]), strategies=strategies,
        notes=tuple(str(note) for note in content["notes"]),
        provenance={str(name): str(value) for name, value in content["provenance"].items()})


def _strategy(held: Mapping[str, Any], estimate: Estimate) -> StrategyResult:
    spp = _array(held["spp"], 1)
    curves = {str(name): _array(values, 2) for name, values in held["curves"].items()}
    scores = {str(name): float(value) for name, value in held["scores"].items()}
    known = {metric.name: metric.at_prefixes for metric in metrics.METRICS}
    if {**dict.fromkeys(curves, True), **dict.fromkeys(scores, False)} != known:  # written before one was added
        raise ValueError(f"{held['strategy']}: metrics {', '.join((*curves, *scores))}; this version measures "
                         f"{', '.join(known)}")
    shapes = {name: curve.shape for name, curve in curves.items()}
    if len(set(shapes.values())) != 1 or curves["rmse"].shape[1] != spp.size or not curves["rmse"].size:
        raise ValueError(f"{held['strategy']}: curves of shapes {shapes} over {spp.size} prefixes")
    return StrategyResult(
        strategy=str(held["strategy"]), suits=bool(held["suits"]), warning=str(held["warning"]),
        spp=spp.astype(np.int64), curves=curves, scores=scores, estimate=estimate,
        verdict=_verdict(held["verdict"]),
        tiles=Tiles(_finding(held["tiles"]["coarse"]), _finding(held["tiles"]["fine"])),
        slope=None if held["slope"] is None else _slope(held["slope"]),
        seconds_per_spp=float(held["seconds_per_spp"]), device=str(held["device"]))


def _verdict(held: Mapping[str, Any]) -> MeanErrorVerdict:
    arrays = {name: _array(held[name], 1) for name in ("error", "low", "high", "dof", "smallest_detectable")}
    if any(array.shape != (4,) for array in arrays.values()):
        raise ValueError("a verdict without four channels")
    return MeanErrorVerdict(outcome=_outcome(held), reason=str(held["reason"]), tolerance=float(held["tolerance"]),
                            confidence=float(held["confidence"]), **arrays)


def _finding(held: Mapping[str, Any]) -> TileFinding:
    names = ("tolerance", "fail_level", "pass_level", "critical", "p", "error", "low", "high", "needed")
    reals = {name: float(held[name]) for name in names}
    median, hardest = (float(value) for value in held["detectable"])
    if held["channel"] not in CHANNELS:
        raise ValueError(f"channel {held['channel']!r}")
    return TileFinding(outcome=_outcome(held), reason=str(held["reason"]), tile=int(held["tile"]),
                       z=_array(held["z"], 2), x=int(held["x"]), y=int(held["y"]), channel=held["channel"],
                       detectable=(median, hardest), **reals)


def _outcome(held: Mapping[str, Any]) -> Outcome:
    outcome: Outcome = held["outcome"]
    if outcome not in ("pass", "fail", "inconclusive"):
        raise ValueError(f"outcome {outcome!r}")
    return outcome


def _slope(held: Mapping[str, Any]) -> Slope:
    reals = {name: float(held[name]) for name in ("slope", "low", "high", "confidence", "coefficient")}
    return Slope(**reals, replicas=int(held["replicas"]), points=int(held["points"]))


def _array(held: Sequence[Any], dimensions: int) -> np.ndarray:
    """Nested lists as a float64 array of so many dimensions; ValueError for any other shape."""
    array = np.array(held, dtype=np.float64)  # reads 'nan' and 'inf' too
    if array.ndim != dimensions:
        raise ValueError(f"an array of {array.ndim} dimensions where {dimensions} belong")
    return cast(np.ndarray, array)
