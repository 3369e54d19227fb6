"""Keeps a calibration as JSON, for the report."""

from __future__ import annotations

import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, TypeVar

from harness.errors import StoreError
from harness.files import write_atomically
from harness.stats.calibration import Calibration, FalseAlarms, Power
from harness.stats.suites import GatePower, GateRates, SuiteRates

Row = TypeVar("Row", FalseAlarms, Power, GateRates, GatePower)


def save(calibration: Calibration, path: Path) -> None:
    """Write the calibration as JSON. StoreError when that cannot be written."""
    with write_atomically(path) as partial:
        partial.write_text(json.dumps(asdict(calibration), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def load(path: Path) -> Calibration:
    """The calibration that `save` wrote; StoreError where the file is not one, or one of an older version."""
    try:
        held = json.loads(path.read_text(encoding="utf-8"))
        suite = held["suite"]
        return Calibration(
            _texts(held["cases"]), _rows(FalseAlarms, held["alarms"]), _rows(Power, held["powers"]),
            SuiteRates(str(suite["file"]), float(suite["false_alarms"]), float(suite["level"]), int(suite["runs"]),
                       int(suite["failed"]), int(suite["red"]), _rows(GateRates, suite["gates"]),
                       _rows(GatePower, suite["powers"])),
            _texts(held["facts"]), _rows(Power, held["coupled"]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise StoreError(f"{path}: not a calibration ({type(error).__name__}: {error}); run `harness calibrate` again"
                         ) from None


def _texts(held: dict[str, Any]) -> dict[str, str]:
    return {str(name): str(text) for name, text in held.items()}


def _rows(kind: type[Row], held: list[dict[str, Any]]) -> tuple[Row, ...]:
    return tuple(kind(**{field.name: _TYPES[str(field.type)](row[field.name]) for field in fields(kind)})
                 for row in held)


def _optional(value: float | None) -> float | None:
    return None if value is None else float(value)


# By the annotations of the rows' fields, which are strings.
_TYPES: dict[str, Any] = {"str": str, "int": int, "float": float, "Where": str, "float | None": _optional}
