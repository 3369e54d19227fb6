"""Where the functions of a shader stand: their file, their lines, and what they take."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from harness.shader.source import ShaderSource

# A definition, at the beginning of a line: type, name, parameters, and a brace, perhaps on the next line.
_DEFINITION = re.compile(r"^(?P<type>\w+)[ \t]+(?P<name>\w+)[ \t]*\((?P<takes>[^;{}()]*)\)\s*\{", re.MULTILINE)
_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)


@dataclass(frozen=True)
class Function:
    """A function of a shader: `file` as messages call it, its first and last line, `signature` without the names'
    spacing, and its text without comments."""

    name: str
    file: str
    line: int
    last: int
    signature: str
    text: str


def functions(source: ShaderSource) -> Mapping[str, Function]:
    """Every function of a shader by its name; of several with one name the first."""
    found: dict[str, Function] = {}
    for file, content in source.files:
        for function in functions_of(file, content):
            found.setdefault(function.name, function)
    return found


def functions_of(file: str, content: str) -> list[Function]:
    """The functions that one file defines, in order."""
    text = _COMMENT.sub(lambda comment: re.sub(r"[^\n]", " ", comment[0]), content)
    result = []
    for match in _DEFINITION.finditer(text):
        end = _closing(text, match.end() - 1)
        takes = " ".join(match["takes"].split())
        result.append(Function(match["name"], file, text.count("\n", 0, match.start()) + 1,
                               text.count("\n", 0, end) + 1, f"{match['type']} {match['name']}({takes})",
                               " ".join(text[match.start():end + 1].split())))
    return result


def _closing(text: str, opening: int) -> int:
    """The index of the brace that closes the one at `opening`; the last character where none does."""
    depth = 0
    for index in range(opening, len(text)):
        depth += {"{": 1, "}": -1}.get(text[index], 0)
        if depth == 0:
            return index
    return len(text) - 1
