"""GLSL literals and small generated functions: what every module that writes GLSL shares."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

# Literals outside this range are written with an exponent, which is shorter.
SMALLEST_POSITIONAL, LARGEST_POSITIONAL = 1e-4, 1e7


def number(value: float) -> str:
    """The shortest decimal that reads back as the same float32.

    By dragon4 itself: str() follows NumPy's print options, which a notebook or a package (colour-science) may change.
    """
    single = np.float32(value) + np.float32(0)  # + 0 turns -0 into 0, which compilers fold away
    if single == 0 or SMALLEST_POSITIONAL <= abs(single) < LARGEST_POSITIONAL:
        return np.format_float_positional(single, trim="0")
    return np.format_float_scientific(single, trim="0")


def vector(values: Any) -> str:
    """A vec2, vec3 or vec4 of as many numbers."""
    return f"vec{len(values)}({', '.join(map(number, values))})"


def rows(matrix: np.ndarray) -> str:
    """The first three rows of an affine (4, 4) matrix as three vec4, separated by commas."""
    return ", ".join(vector(row) for row in matrix[:3])


def is_any(ids: Sequence[int]) -> str:
    """The condition that `id` is one of `ids`."""
    return " || ".join(f"id == {index}" for index in ids)


def selected(kind: str, name: str, values: Sequence[str], otherwise: str) -> list[str]:
    """Statements that declare `name` as the value of shape `id`: selects, one per distinct value, commonest first."""
    return chosen(kind, name, dict(enumerate(values)) or {0: otherwise})


def chosen(kind: str, name: str, values: Mapping[int, str]) -> list[str]:
    """The same where only some shapes have a value, at least one; for the others it is one of those."""
    (first, _), *others = grouped(values)
    return [f"{kind} {name} = {first};", *(f"if ({is_any(ids)}) {name} = {value};" for value, ids in others)]


def grouped(values: Mapping[int, str]) -> list[tuple[str, list[int]]]:
    """Distinct values with the shapes that have them, commonest first."""
    groups: dict[str, list[int]] = {}
    for index, value in values.items():
        groups.setdefault(value, []).append(index)
    return sorted(groups.items(), key=lambda item: -len(item[1]))


def function(signature: str, body: Sequence[str]) -> list[str]:
    """A GLSL function and an empty line."""
    return [signature, "{", *(f"    {line}" for line in body), "}", ""]


def in_comment(name: str) -> str:
    """A name that cannot end its line's comment or continue it: printable ASCII without the backslash."""
    return re.sub(r"[^ -\[\]-~]", "?", name)
