"""GLSL's conditionals decided: what a preprocessor would leave of a shader whose macros are all known, with its comments.

A shader that a person will read should not carry the branches that its scene has no use for.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from harness.errors import ShaderError

_DIRECTIVE = re.compile(r"^\s*#\s*(?P<name>\w+)\s*(?P<rest>.*?)\s*(?://.*)?$")
_MARK = re.compile(r"^#line \d+ \d+ // (?P<file>.+)$")
_WORD = re.compile(r"[A-Za-z_]\w*")
# What may be left of a condition once its macros have been replaced.
_ARITHMETIC = re.compile(r"(?:\d+|and|or|not|[-+*/%<>=!()\s])*")
_DEPTH = 32  # macros within macros, beyond which they must go round in a circle


@dataclass(frozen=True)
class Line:
    """A line that stays: `file` is the library file that it stands in."""

    file: str
    text: str


def resolve(text: str) -> list[Line]:
    """The lines of an assembled shader (harness/shader/source.py) that its own `#define`s choose.

    `#define`s stay where code comes that may name them; `#version`, `#line` and include guards go.
    ShaderError for a condition that is no arithmetic on known macros, or a block that does not end.
    """
    return list(_resolved(text.splitlines()))


def _resolved(lines: Iterable[str]) -> Iterator[Line]:
    macros: dict[str, str] = {}
    file = ""
    blocks: list[tuple[bool, bool]] = []  # of each open #if: whether lines count now, whether a branch has been taken
    for text in lines:
        if mark := _MARK.match(text):
            file = mark["file"]
            continue
        found = _DIRECTIVE.match(text)
        counts = all(now for now, _ in blocks)
        if not found:
            if counts:
                yield Line(file, text.rstrip())
            continue
        name, rest = found["name"], found["rest"]
        if name in ("if", "ifdef", "ifndef"):
            now = counts and _holds(name, rest, macros, file)
            blocks.append((now, now))
        elif name in ("elif", "else", "endif"):
            if not blocks:
                raise ShaderError(f"{file}: '#{name}' without '#if'; take one away, or add the other")
            _, taken = blocks.pop()
            if name != "endif":
                outside = all(now for now, _ in blocks)
                now = outside and not taken and (name == "else" or _holds("if", rest, macros, file))
                blocks.append((now, taken or now))
        elif counts and name == "define":
            macro, _, value = rest.partition(" ")
            macros[macro] = value.strip()
            if value:  # a guard has none
                yield Line(file, f"#define {macro} {value.strip()}")
        elif counts and name not in ("version", "line"):
            yield Line(file, text.rstrip())
    if blocks:
        raise ShaderError(f"{file}: an '#if' that no '#endif' ends; add it")


def _holds(directive: str, condition: str, macros: dict[str, str], file: str) -> bool:
    if directive != "if":
        return (condition in macros) == (directive == "ifdef")
    expression = re.sub(r"defined\s*\(?\s*(\w+)\s*\)?", lambda word: str(int(word[1] in macros)), condition)
    for _ in range(_DEPTH):
        replaced = _WORD.sub(lambda word: f"({macros[word[0]]})" if word[0] in macros else word[0], expression)
        if replaced == expression:
            break
        expression = replaced
    logical = re.sub(r"!(?!=)", " not ", expression.replace("&&", " and ").replace("||", " or "))
    try:
        if not _ARITHMETIC.fullmatch(logical):
            raise ValueError
        return bool(eval(logical.strip(), {"__builtins__": {}}))  # numbers and operators only, as was just asked
    except (ValueError, SyntaxError, ArithmeticError, TypeError, RecursionError):
        raise ShaderError(f"{file}: cannot decide '#if {condition}'; use numbers and macros that are defined "
                          "above it") from None
