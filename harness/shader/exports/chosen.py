"""The lines of an assembled shader that its macros choose, with their comments and the library file of each.

A shader that a person will read should not carry the branches that its scene has no use for.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from harness.shader.conditionals import preprocess
from harness.shader.lexer import without_comments

_MARK = re.compile(r"^#line \d+ \d+ // (?P<file>.+)$")
_DIRECTIVE = re.compile(r"^\s*#\s*(?P<word>\w+)")
_VALUE = re.compile(r"^\s*#\s*define\s+\w+(?:\([^)]*\))?\s+\S")  # a guard has none
_KEPT = "\x01"  # stands for a line; where the preprocessor leaves it, the line is kept


@dataclass(frozen=True)
class Line:
    """A line that stays: `file` is the library file that it stands in."""

    file: str
    text: str


def chosen(text: str) -> list[Line]:
    """The lines of an assembled shader (harness/shader/source.py) that its own `#define`s choose.

    `#define`s with a value stay, since code below may name them; conditionals, `#version` and `#line` go.
    """
    return list(_chosen(text))


def _chosen(text: str) -> Iterator[Line]:
    lines = text.splitlines()
    bare = without_comments(text, "").splitlines()
    # Two lines for each: whether it is kept, and what it tells the preprocessor.
    asked = "\n".join(f"{_KEPT}\n{line if _DIRECTIVE.match(line) else ''}" for line in bare)
    answered = preprocess(asked).text.split("\n")[::2]
    file = ""
    for line, code, kept in zip(lines, bare, answered, strict=True):
        if mark := _MARK.match(line):
            file = mark["file"]
            continue
        directive = _DIRECTIVE.match(code)
        if _KEPT in kept and (not directive or (directive["word"] == "define" and _VALUE.match(code))):
            yield Line(file, line.rstrip())
