"""Estimates and batches as OpenEXR files that any viewer opens, that carry their metadata, and that show damage."""

from __future__ import annotations

import hashlib
import io
import json
import os
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, redirect_stdout
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from harness.errors import StoreError
from harness.files import write_atomically
from harness.samples.cost import Cost
from harness.samples.estimate import Batch, Estimate, luminance

Value = str | int | float

# Rec.709 primaries and D65 white, x and y of red, green, blue, white (ITU-R BT.709-6, item 1.3 and 1.4).
REC709 = (0.640, 0.330, 0.300, 0.600, 0.150, 0.060, 0.3127, 0.3290)

_ESTIMATE, _BATCH, _SEAL = "harness.samples.estimate", "harness.batch", "harness.sha256"
MAGIC = b"\x76\x2f\x31\x01"  # what every file of the format begins with
_BLANK = b"0" * 64  # what the seal holds while the file is hashed
_SEAL_HEAD = _SEAL.encode() + b"\0string\0" + len(_BLANK).to_bytes(4, "little")
_COLOURS = ("R", "G", "B")
_LARGEST = ("largest.R", "largest.G", "largest.B")
_VARIANCES = ("variance.R", "variance.G", "variance.B", "variance.Y")
_THIRDS = ("third.R", "third.G", "third.B")
_INT32 = 2**31
# Attributes of the format itself (OpenEXR file layout, "Predefined attributes"); the rest of a header is metadata.
_STRUCTURE = frozenset((
    "channels", "chromaticities", "chunkCount", "compression", "dataWindow", "displayWindow", "lineOrder",
    "maxSamplesPerPixel", "name", "pixelAspectRatio", "preview", "screenWindowCenter", "screenWindowWidth", "tiles",
    "type", "version", "view"))
_silence = threading.Lock()


def write_estimate(path: str | Path, estimate: Estimate, metadata: Mapping[str, Any] | None = None) -> None:
    """Write an estimate: R, G, B in linear Rec.709 float32, and the variance of the mean as layer `variance`.

    The layer (R, G, B, and Y for luminance) is left out where the variance is unknown, and so is `third`, the third
    central moment of the mean (R, G, B). `metadata` becomes header
    attributes: strings; integers, as decimal text beyond 32 bits; floats, to 7 digits as the format has them; anything
    else as text. Pixels that are not finite are kept as they are. StoreError when the file cannot be written.
    """
    channels = dict(zip(_COLOURS, np.moveaxis(estimate.mean, -1, 0), strict=True))
    if not np.isnan(estimate.variance).all():
        layers = (*np.moveaxis(estimate.variance, -1, 0), estimate.luminance_variance)
        channels |= dict(zip(_VARIANCES, layers, strict=True))
    if estimate.third is not None:
        channels |= dict(zip(_THIRDS, np.moveaxis(estimate.third, -1, 0), strict=True))
    facts = {"samples": estimate.samples, "batches": estimate.batches, "rejected": estimate.rejected,
             "cost": asdict(estimate.cost), "image_mean": estimate.image_mean.tolist(),
             "image_variance": estimate.image_variance.tolist()}
    if estimate.image_third is not None:
        facts["image_third"] = estimate.image_third.tolist()
    _write(Path(path), channels, {**(metadata or {}), _ESTIMATE: json.dumps(facts)})


def read_estimate(path: str | Path) -> tuple[Estimate, dict[str, Value]]:
    """Read an estimate and its metadata; any EXR file with channels R, G and B will do.

    In a file that this harness did not write, the variance is NaN (unknown) and the samples are its `spp` attribute
    or 0. StoreError when the file is missing, not EXR, damaged, or lacks a colour channel.
    """
    found = read_exr(path)
    return found.estimate, found.metadata


@dataclass(frozen=True, eq=False)
class ReadExr:
    """What `read_estimate` gives, and what a reader should know besides: alpha below 1, further parts."""

    estimate: Estimate
    metadata: dict[str, Value]
    notes: tuple[str, ...]


def read_exr(path: str | Path) -> ReadExr:
    """Read an estimate as `read_estimate` does, with notes on what of the file is not in it.

    Of several parts the first with R, G and B is taken.
    """
    path = Path(path)
    channels, metadata, notes = _read(path)
    if "A" in channels and (share := float((channels["A"] < 1).mean())) > 0:
        # By the format's convention colours are multiplied by alpha already: what they hold is the radiance over black.
        notes = (*notes, f"alpha is below 1 in {share:.2%} of the pixels; the colours are taken as they are, over "
                         "black: a background that another program adds is not in them")
    return ReadExr(*_estimate(path, channels, metadata), notes)


def _estimate(path: Path, channels: Mapping[str, np.ndarray], metadata: dict[str, Value]) -> tuple[
        Estimate, dict[str, Value]]:
    mean = _stack(path, channels, _COLOURS)
    text = metadata.pop(_ESTIMATE, None)
    metadata.pop(_BATCH, None)
    if text is None:
        spp = metadata.get("spp")
        image_mean = np.append(mean.mean((0, 1)), luminance(mean).mean())
        return Estimate(mean, np.full_like(mean, np.nan), np.full(mean.shape[:2], np.nan), image_mean,
                        np.full(4, np.nan), samples=spp if isinstance(spp, int) else 0, batches=1), metadata
    facts = _facts(path, text, ("samples", "batches", "rejected", "cost", "image_mean", "image_variance"),
                   optional=("image_third",))  # files that were written before it was kept have none
    if _VARIANCES[0] in channels:
        variance = _stack(path, channels, _VARIANCES)
    else:
        variance = np.full((*mean.shape[:2], 4), np.nan)
    image_third = facts["image_third"]
    return Estimate(mean, variance[..., :3], variance[..., 3], np.array(facts["image_mean"], dtype=np.float64),
                    np.array(facts["image_variance"], dtype=np.float64), samples=facts["samples"],
                    batches=facts["batches"], rejected=facts["rejected"], cost=facts["cost"],
                    third=_stack(path, channels, _THIRDS) if _THIRDS[0] in channels else None,
                    image_third=None if image_third is None else np.array(image_third, dtype=np.float64)), metadata


def write_batch(path: str | Path, batch: Batch, metadata: Mapping[str, Any] | None = None, *,
                compact: bool = False) -> None:
    """Write a batch, exactly; `metadata` as in `write_estimate`. StoreError when the file cannot be written.

    `compact`: in two thirds of the room, for readers that know OpenEXR 3.4 (2025) or newer.
    """
    facts = {"samples": batch.samples, "rejected": batch.rejected, "cost": asdict(batch.cost)}
    channels = dict(zip(_COLOURS, np.moveaxis(batch.mean, -1, 0), strict=True))
    if batch.largest is not None:
        channels |= dict(zip(_LARGEST, np.moveaxis(batch.largest, -1, 0), strict=True))
    # Lossless JPEG 2000: of batches of 32 samples and more it leaves 64 %, where ZIP leaves 87 and Zstandard 73. One of
    # 170 x 170 pixels takes 4.6 ms of CPU time to write (1.3 ms without compression), and 150 to 440 ms to draw.
    compression = OpenEXR.HTJ2K256_COMPRESSION if compact else OpenEXR.NO_COMPRESSION
    _write(Path(path), channels, {**(metadata or {}), _BATCH: json.dumps(facts)}, compression)


def read_batch(path: str | Path, expected: Mapping[str, Any] | None = None) -> Batch:
    """Read a batch; StoreError when the file is missing, damaged, not a batch of this harness, or where its metadata
    say something else than `expected`."""
    path = Path(path)
    channels, metadata, _ = _read(path)
    if _BATCH not in metadata:
        raise StoreError(f"{path}: not a batch, it lacks the attribute '{_BATCH}'; remove it and render again")
    for name, value in (expected or {}).items():
        if str(found := metadata.get(name, value)) != str(value):
            raise StoreError(f"{path}: another batch than its name says ({name} {found}, not {value}); remove it and "
                             "render again")
    facts = _facts(path, metadata[_BATCH], ("samples", "rejected", "cost"))
    largest = _stack(path, channels, _LARGEST).astype(np.float32) if _LARGEST[0] in channels else None
    return Batch(_stack(path, channels, _COLOURS).astype(np.float32), facts["samples"], facts["rejected"],
                 facts["cost"], largest)


def _write(path: Path, channels: Mapping[str, np.ndarray], metadata: Mapping[str, Any],
           compression: Any = OpenEXR.ZIP_COMPRESSION) -> None:
    header: dict[str, Any] = {name: _attribute(value) for name, value in metadata.items()}
    if not _STRUCTURE.isdisjoint(header):
        raise ValueError(f"metadata must not be called {', '.join(sorted(_STRUCTURE.intersection(header)))}")
    header |= {"type": OpenEXR.scanlineimage, "compression": compression, "chromaticities": REC709,
               _SEAL: _BLANK.decode()}
    pixels = {name: np.ascontiguousarray(values, dtype=np.float32) for name, values in channels.items()}
    buffer = io.BytesIO()
    with OpenEXR.File(header, pixels) as file:
        file.write(buffer)
    with write_atomically(path) as partial:
        partial.write_bytes(_sealed(buffer.getvalue()))


def read_bytes(path: Path, kind: str) -> bytes:
    """All bytes of a regular file; StoreError in one line where it cannot be read. `kind`: 'EXR', say."""
    try:
        if path.exists() and not path.is_file() and not path.is_dir():  # a device might never end
            raise StoreError(f"{path}: not a regular file; name a readable {kind} file")
        return path.read_bytes()
    except FileNotFoundError as error:
        raise StoreError(f"{path}: no such file; check the name, or render it first") from error
    except OSError as error:
        raise StoreError(f"{path}: cannot be read ({error.strerror or error}); name a readable {kind} file") from error


def _read(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Value], tuple[str, ...]]:
    """All channels of the first part that has colours (else of the first), its metadata, and a note where there are
    other parts; StoreError as `read_estimate`."""
    data = read_bytes(path, "EXR")
    if data[:4] != MAGIC:
        raise StoreError(f"{path}: not an OpenEXR file; convert it to EXR, or render it again")
    intact = _seal_holds(data)
    damaged = StoreError(f"{path}: truncated or damaged EXR file; remove it and render it again")
    if intact is False:
        raise damaged
    notes: tuple[str, ...] = ()
    try:
        with (nullcontext() if intact else _silenced()), OpenEXR.File(io.BytesIO(data), separate_channels=True) as file:
            part = next((part for part in file.parts if set(_COLOURS) <= set(part.channels)), file.parts[0])
            if len(file.parts) > 1:
                notes = (f"of its {len(file.parts)} parts, '{part.header.get('name', '')}' is read, the first with "
                         "R, G and B",)
            header = dict(part.header)  # emptied when the file is closed
            channels = {name: np.asarray(channel.pixels) for name, channel in part.channels.items()}
    except Exception as error:  # the library raises whatever its many layers do
        raise damaged from error
    metadata = {name: value for name, value in header.items()
                if name not in _STRUCTURE and name != _SEAL and isinstance(value, str | int | float)}
    if intact is None and (_ESTIMATE in metadata or _BATCH in metadata):
        raise damaged
    return channels, metadata, notes


def _stack(path: Path, channels: Mapping[str, np.ndarray], names: tuple[str, ...]) -> np.ndarray:
    """Channels as one (H, W, len(names)) float64 array."""
    missing = [name for name in names if name not in channels]
    if missing:
        raise StoreError(f"{path}: lacks channel {', '.join(missing)}, holds {', '.join(sorted(channels)) or 'none'}; "
                         "write it as an RGB image")
    planes = [channels[name] for name in names]
    if any(plane.ndim != 2 or plane.dtype.kind not in "fu" or plane.shape != planes[0].shape for plane in planes):
        raise StoreError(f"{path}: channels {', '.join(names)} are deep, subsampled or not numbers; "
                         "write it as a plain RGB image")
    return np.stack(planes, axis=-1).astype(np.float64)


def _facts(path: Path, text: Value, names: tuple[str, ...], optional: tuple[str, ...] = ()) -> dict[str, Any]:
    try:
        facts = json.loads(str(text))
        facts["cost"] = Cost(**facts["cost"])
        return {**{name: facts[name] for name in names}, **{name: facts.get(name) for name in optional}}
    except (ValueError, KeyError, TypeError) as error:
        raise StoreError(f"{path}: written by another version of this harness; render it again") from error


def _attribute(value: object) -> Value:
    """A metadata value as one of the types that an EXR header holds."""
    if isinstance(value, int | np.integer):  # a larger one would wrap silently
        return int(value) if -_INT32 <= value < _INT32 else str(value)
    if isinstance(value, float | np.floating):
        return float(value)
    return str(value)


def _sealed(data: bytes) -> bytes:
    """The file with the hash of all its bytes in its header, in place of the blank."""
    start = data.index(_SEAL_HEAD) + len(_SEAL_HEAD)
    return data[:start] + hashlib.sha256(data).hexdigest().encode() + data[start + len(_BLANK):]


def _seal_holds(data: bytes) -> bool | None:
    """Is the file, byte for byte, what this harness wrote? None where it carries no seal: somebody else's file.

    The library takes damaged pixels for good ones where they are not compressed, and complains to stderr and stdout
    where it notices; the seal finds any damage without asking it.
    """
    start = data.find(_SEAL_HEAD)
    if start < 0:
        return None
    start += len(_SEAL_HEAD)
    end = start + len(_BLANK)
    return hashlib.sha256(data[:start] + _BLANK + data[end:]).hexdigest().encode() == data[start:end]


@contextmanager
def _silenced() -> Iterator[None]:
    """Keep what the EXR library prints about damaged files off stderr, where it writes from C, and off stdout."""
    with _silence, redirect_stdout(io.StringIO()), tempfile.TemporaryFile() as sink:
        sys.stderr.flush()
        saved = os.dup(2)
        try:
            os.dup2(sink.fileno(), 2)
            yield
        finally:
            os.dup2(saved, 2)
            os.close(saved)
