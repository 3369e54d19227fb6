"""Keeps a calibration as JSON, for the report."""

from __future__ import annotations

from pathlib import Path

from harness.samples import json
from harness.stats.calibration import Calibration


def save(calibration: Calibration, path: Path) -> None:
    """Write the calibration as JSON. StoreError when that cannot be written."""
    json.save(path, calibration)


def load(path: Path) -> Calibration:
    """The calibration that `save` wrote; StoreError where the file is not one, or one of an older version."""
    return json.load(path, lambda held: json.built(Calibration, held), what="a calibration",
                     mend="run `harness calibrate` again")
