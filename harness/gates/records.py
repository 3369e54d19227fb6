"""Records of gates as JSON types and back: for result.json, the summary, `--json`, and pytest-xdist's workers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from typing import Any

from harness.results import AgreementRecord, GateNumbers, GateRecord, LookRecord, PartRecord, PointRecord, RungRecord


def as_json(record: GateRecord) -> dict[str, Any]:
    """One flat object, in which the numbers stand beside the rest; what is empty is left out."""
    told = {name: value for name, value in asdict(replace(record, numbers=None)).items() if value}
    if record.numbers is None:
        return told
    numbers = asdict(record.numbers)
    if record.numbers.agreement is None:
        del numbers["agreement"]
    return told | numbers


def from_json(held: Mapping[str, Any]) -> GateRecord:
    """The record that `as_json` wrote. KeyError and TypeError for anything else."""
    numbers = None
    if "tests" in held:
        given = {field.name: held[field.name] for field in fields(GateNumbers) if field.name in held}
        if agreement := given.get("agreement"):
            given["agreement"] = AgreementRecord(**agreement)
        numbers = GateNumbers(**{
            **given, **{name: tuple(given[name]) for name in ("error", "low", "high")},
            "tests": {name: PartRecord(**part) for name, part in given["tests"].items()},
            "looks": tuple(LookRecord(**look) for look in given["looks"]),
            "curve": tuple(PointRecord(**point) for point in given["curve"])})
    told = {field.name: held[field.name] for field in fields(GateRecord) if field.name in held}
    told["ladder"] = tuple(RungRecord(**rung) for rung in held.get("ladder", ()))
    return GateRecord(**told, numbers=numbers)
