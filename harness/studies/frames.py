"""A study's table as others' data structures: pandas and xarray, which the extra `tables` brings."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Sequence
from typing import Any

from harness.errors import MachineError
from harness.results import Record
from harness.studies.parameters import is_numeric
from harness.studies.table import KINDS, columns

# Columns along which a curve lies, besides the parameters'.
DIMENSIONS = ("scene", "estimator", "replica", "samples")


def to_pandas(rows: Iterable[Record]) -> Any:
    """The table as a `pandas.DataFrame`, one number a row; parameters that are numbers are numbers.

    MachineError where pandas is not installed.
    """
    pandas = _required("pandas")
    kinds = {int: "Int64", float: "float64", str: "string"}
    frame = pandas.DataFrame(columns(rows))
    return frame.astype({name: kinds[_kind(name, frame[name].dropna().tolist())] for name in frame.columns})


def to_xarray(rows: Iterable[Record]) -> Any:
    """The curves as an `xarray.Dataset`: one variable a metric, over scene, estimator, each parameter, replica and
    samples per pixel; NaN where a combination was not measured.

    MachineError where xarray is not installed.
    """
    xarray = _required("xarray")
    held = list(rows)
    names = [name for name in columns(held) if name not in KINDS]
    frame = to_pandas(row for row in held if row.replica is not None)
    dimensions = [*DIMENSIONS[:2], *names, *DIMENSIONS[2:]]
    plain = frame.astype({"replica": "int64", "samples": "int64", "scene": object, "estimator": object})
    for name in names:  # a scene may be without a parameter that another has
        plain[name] = plain[name].fillna("").astype(object) if plain[name].dtype == "string" else plain[name]
    curves = {quantity: rows.set_index(dimensions)["value"].to_xarray()
              for quantity, rows in plain.groupby("quantity", sort=False)}
    return xarray.Dataset(curves)


def _kind(name: str, values: Sequence[Any]) -> type:
    if name in KINDS:
        return KINDS[name]
    return float if is_numeric(values) else str


def _required(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise MachineError(f"{name} is not installed; pip install 'glsl-validation-harness[tables]'") from None
