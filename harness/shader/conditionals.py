"""Which lines of a GLSL text the preprocessor keeps: #if, #ifdef and their like, evaluated as a compiler does."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from harness.shader.lexer import hidden

# A directive with its continued lines.
_DIRECTIVE = re.compile(r"^[ \t]*#[ \t]*(?P<word>\w*)(?P<rest>(?:\\\r?\n|[^\n])*)", re.MULTILINE)
_DEFINE = re.compile(r"\s*(\w+)(\([^)]*\))?\s*(.*)", re.DOTALL)
_DEFINED = re.compile(r"\bdefined\s*(?:\(\s*(\w+)\s*\)|(\w+))")
_PART = re.compile(r"\s*(0[xX][0-9a-fA-F]+|\d+|\w+|<<|>>|<=|>=|==|!=|&&|\|\||[-+*/%<>!~&|^()])")
# Macros may name each other in circles, or double with each name.
_DEPTH, _LENGTH = 32, 10_000


def _divide(a: int, b: int) -> int:
    if b == 0:
        raise ValueError("division by zero")
    return abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)


# Binary operators, from the weakest (GLSL 4.60, section 3.3).
_LEVELS: tuple[Mapping[str, Callable[[int, int], int]], ...] = (
    {"||": lambda a, b: int(bool(a or b))}, {"&&": lambda a, b: int(bool(a and b))},
    {"|": operator.or_}, {"^": operator.xor}, {"&": operator.and_},
    {"==": lambda a, b: int(a == b), "!=": lambda a, b: int(a != b)},
    {"<": lambda a, b: int(a < b), ">": lambda a, b: int(a > b), "<=": lambda a, b: int(a <= b),
     ">=": lambda a, b: int(a >= b)},
    {"<<": lambda a, b: a << min(max(b, 0), 64), ">>": lambda a, b: a >> min(max(b, 0), 64)},
    {"+": operator.add, "-": operator.sub},
    {"*": operator.mul, "/": _divide, "%": lambda a, b: a - b * _divide(a, b)},
)


@dataclass(frozen=True)
class Preprocessed:
    """`text`: as long as what was read, spaces for directives and for lines that are not kept; `macros`: what is
    defined at its end, macros with arguments by their name with a bracket behind it."""

    text: str
    macros: Mapping[str, str]


def preprocess(text: str, defines: Mapping[str, str] | None = None) -> Preprocessed:
    """The lines of a text without comments that are kept where `defines` are defined.

    A condition that cannot be evaluated holds: nothing is hidden for a reason that nobody understands.
    """
    macros = dict(defines or {})
    branches = _Branches()
    output: list[str] = []
    done = 0
    for match in _DIRECTIVE.finditer(text):
        piece = text[done:match.start()]
        output += [piece if branches.kept else hidden(piece), hidden(match[0])]
        done = match.end()
        _obey(match["word"], match["rest"].replace("\\\r\n", " ").replace("\\\n", " "), macros, branches)
    rest = text[done:]
    output.append(rest if branches.kept else hidden(rest))
    return Preprocessed("".join(output), macros)


class _Branches:
    """The conditions that are open."""

    def __init__(self) -> None:
        self._stack: list[tuple[bool, bool]] = []  # of each: its lines are kept; one of its branches was taken
        self._left_out = 0

    @property
    def kept(self) -> bool:
        """Whether all of them hold."""
        return not self._left_out

    def open(self, holds: bool) -> None:
        self._stack.append((holds, holds))
        self._left_out += not holds

    def otherwise(self, holds: Callable[[], bool]) -> None:
        """The next branch of the innermost one."""
        if self._stack:
            before, taken = self._stack[-1]
            now = not taken and holds()
            self._stack[-1] = now, taken or now
            self._left_out += before - now

    def close(self) -> None:
        if self._stack:
            self._left_out -= not self._stack.pop()[0]


def _obey(word: str, rest: str, macros: dict[str, str], branches: _Branches) -> None:
    if word in ("if", "ifdef", "ifndef"):
        name = rest.split()[0] if rest.split() else ""
        branches.open(_holds(rest, macros) if word == "if" else _is_defined(name, macros) == (word == "ifdef"))
    elif word in ("elif", "else"):
        branches.otherwise(lambda: word == "else" or _holds(rest, macros))
    elif word == "endif":
        branches.close()
    elif word == "define" and branches.kept and (found := _DEFINE.match(rest)):
        macros[found[1] + ("(" if found[2] else "")] = found[3].strip()
    elif word == "undef" and branches.kept and rest.split():
        macros.pop(rest.split()[0], None)
        macros.pop(rest.split()[0] + "(", None)


def _is_defined(name: str, macros: Mapping[str, str]) -> bool:
    return name in macros or f"{name}(" in macros


def _holds(expression: str, macros: Mapping[str, str]) -> bool:
    try:
        return bool(_Expression(_expanded(expression, macros)).value())
    except (ValueError, RecursionError):
        return True


def _expanded(expression: str, macros: Mapping[str, str]) -> str:
    """The expression with numbers for what is defined; names that nobody defined are 0, as in C."""
    text = _DEFINED.sub(lambda found: str(int(_is_defined(found[1] or found[2], macros))), expression)
    for _ in range(_DEPTH):
        replaced = re.sub(r"\b[A-Za-z_]\w*\b", lambda found: macros.get(found[0], "0") or "0", text)
        if replaced == text:
            return text
        if len(replaced) > _LENGTH:
            break
        text = replaced
    raise ValueError("macros that name each other")


class _Expression:
    """A recursive descent over the integer expressions of the preprocessor; ValueError for anything else."""

    def __init__(self, text: str) -> None:
        self._parts: list[str] = []
        at = 0
        text = text.strip()
        while at < len(text):
            if not (found := _PART.match(text, at)):
                raise ValueError(f"not an integer expression: {text}")
            self._parts.append(found[1])
            at = found.end()
        self._at = 0

    def value(self) -> int:
        result = self._binary(0)
        if self._at != len(self._parts):
            raise ValueError("more than one expression")
        return result

    def _peek(self) -> str:
        return self._parts[self._at] if self._at < len(self._parts) else ""

    def _binary(self, level: int) -> int:
        if level == len(_LEVELS):
            return self._unary()
        left = self._binary(level + 1)
        while (sign := self._peek()) in _LEVELS[level]:
            self._at += 1
            left = _LEVELS[level][sign](left, self._binary(level + 1))
        return left

    def _unary(self) -> int:
        part = self._peek()
        self._at += 1
        if part in ("!", "-", "+", "~"):
            value = self._unary()
            return {"!": int(not value), "-": -value, "+": value, "~": ~value}[part]
        if part == "(":
            value = self._binary(0)
            if self._peek() != ")":
                raise ValueError("a bracket that nothing closes")
            self._at += 1
            return value
        return int(part.rstrip("uU") or "x", 0 if part[:2].lower() == "0x" else 10)
