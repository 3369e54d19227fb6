"""GLSL as text without comments, as tokens, and where a place of a joined text stands in the author's files."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

from harness.errors import ShaderError
from harness.shader.source import LINE_STRIDE, ShaderSource

# One pass: `x; //* y` opens no block, `"file://a"` opens no comment, and a backslash continues a line comment.
_HIDDEN = re.compile(r'"[^"\n]*"|//(?:\\\r?\n|[^\n])*|/\*.*?\*/|(?P<open>/\*.*)', re.DOTALL)
_TOKEN = re.compile(r"(?P<name>[A-Za-z_]\w*)|(?P<number>\.?\d(?:[\w.]|(?<=[eE])[+-])*)|(?P<symbol>[^\s\w])")
_LINE = re.compile(r"^[ \t]*#[ \t]*line[ \t]+(\d+)[^\n]*\n", re.MULTILINE)
# What word processors and web pages leave in a text, and a compiler refuses: no-break space, zero-width characters and
# byte-order marks in the midst of it.
_INVISIBLE = str.maketrans({"\u00a0": " ", "\u200b": " ", "\u200c": " ", "\u200d": " ", "\ufeff": " ", "\u2028": "\n"})


class Token(NamedTuple):
    """A name, a number or one character of punctuation, and where it stands in the text."""

    kind: str
    text: str
    start: int
    end: int


def hidden(text: str) -> str:
    """Spaces for every character but the ends of lines: as long, and as many lines."""
    return re.sub(r"[^\n]", " ", text)


def without_comments(text: str, file: str) -> str:
    """`text` with spaces for its comments; as long, and with as many lines.

    ShaderError, with file and line, for a comment that nothing closes, and for characters outside of comments that GLSL
    does not know (Khronos, GLSL 4.60, section 3.1).
    """
    def blank(match: re.Match[str]) -> str:
        if match["open"] is not None:
            line = text.count("\n", 0, match.start()) + 1
            raise ShaderError(f"{file}:{line}: a comment begins here that nothing closes; close it with */")
        return match[0] if match[0].startswith('"') else hidden(match[0])

    bare = _HIDDEN.sub(blank, text).translate(_INVISIBLE)
    if (strange := re.search(r"[^\x00-\x7f]", re.sub(r'"[^"\n]*"', lambda quoted: hidden(quoted[0]), bare))):
        line = bare.count("\n", 0, strange.start()) + 1
        raise ShaderError(f"{file}:{line}: the character '{strange[0]}' (U+{ord(strange[0]):04X}) outside of a "
                          "comment; GLSL is written in ASCII, type it anew")
    return bare


@lru_cache(maxsize=16)
def tokens(text: str) -> tuple[Token, ...]:
    """The tokens of a text without comments and directives."""
    return tuple(Token(match.lastgroup or "", match[0], match.start(), match.end()) for match in _TOKEN.finditer(text))


@lru_cache(maxsize=16)
def _numbering(text: str) -> tuple[list[int], list[int]]:
    """Where the lines behind each `#line` begin, and the number of the first of them."""
    found = list(_LINE.finditer(text))
    return [0, *(match.end() for match in found)], [1, *(int(match[1]) for match in found)]


def number_at(text: str, offset: int) -> int:
    """The line number that the last `#line` before `offset` gives it (see LINE_STRIDE)."""
    begins, numbers = _numbering(text)
    last = bisect_right(begins, offset) - 1
    return numbers[last] + text.count("\n", begins[last], offset)


def place(source: ShaderSource, offset: int) -> str:
    """'file:line' of a place in a joined text."""
    file, line = divmod(number_at(source.text, offset), LINE_STRIDE)
    name = source.files[file - 1][0] if 1 <= file <= len(source.files) else source.files[0][0]
    return f"{name}:{line}"


def closing(found: Sequence[Token], opening: int) -> int:
    """The index of the token that closes the bracket at `opening`; the number of tokens where none does."""
    pairs: Mapping[str, int] = {"(": 1, "[": 1, "{": 1, ")": -1, "]": -1, "}": -1}
    depth = 0
    for index in range(opening, len(found)):
        depth += pairs.get(found[index].text, 0)
        if depth == 0:
            return index
    return len(found)
