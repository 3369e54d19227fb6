"""What gates left behind, read again: their records, and which files lie beside each."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from harness.gates.left import ALL_PICTURES, AUTOPSY, IMAGES, RESULT_FILE
from harness.gates.records import from_json
from harness.results import GateEvidence


def evidence(folder: Path, warn: Callable[[str], None]) -> tuple[GateEvidence, ...]:
    """Every gate that has a folder somewhere under `folder`, by name; nothing where there is none.

    `warn` is told in one line of a result that cannot be read, which is left out.
    """
    found = []
    for path in sorted(folder.rglob(RESULT_FILE)):
        try:
            record = from_json(json.loads(path.read_text(encoding="utf-8")))
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            warn(f"{path}: not the result of a gate; run the gate again, or remove its folder")
            continue
        known = (*ALL_PICTURES, AUTOPSY, *(name for name in IMAGES if name not in ALL_PICTURES))
        files = tuple(name for name in known if (path.parent / name).is_file())
        found.append(GateEvidence(record, path.parent.relative_to(folder).as_posix(), files))
    return tuple(sorted(found, key=lambda each: (each.record.gate, each.folder)))
