"""Formulas for the HTML page: Typst's notation for mathematics, as far as the report uses it, as MathML.

What is read: numbers, letters, Greek names, `a_b^c`, `a/b` (parentheses around either part go), `( … )`, "text",
operators, and the functions of `_WRAPPED` and `_NAMED`. Typst reads all of it alike.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from html import escape
from typing import NamedTuple

from harness.errors import HarnessError

_TOKEN = re.compile(r'\s*("[^"]*"|\d+(?:\.\d+)?|[a-z]+(?:\.[a-z]+)+|[A-Za-z]+|<=|>=|[-+=_^/(),<>|])')
_GREEK = {"alpha": "α", "beta": "β", "epsilon": "ε", "theta": "θ", "lambda": "λ", "nu": "ν", "pi": "π", "rho": "ρ",
          "sigma": "σ", "tau": "τ", "omega": "ω", "Omega": "Ω"}
_OPERATORS = {"dot": "⋅", "dot.c": "⋅", "times": "×", "plus.minus": "±", "prop": "∝", "approx": "≈", "in": "∈",
              "integral": "∫", "sum": "∑", "product": "∏", "-": "−", "<=": "≤", ">=": "≥", "dots": "…", "slash": "/"}
_SPACES = {"thin": "0.17em", "quad": "1em"}
_NAMED = ("max", "min", "log", "cos")
_WRAPPED: dict[str, Callable[[str], str]] = {
    "bold": lambda inner: f'<mrow class="vector">{inner}</mrow>',
    "hat": lambda inner: f"<mover><mrow>{inner}</mrow><mo>^</mo></mover>",
    "overline": lambda inner: f"<mover><mrow>{inner}</mrow><mo>‾</mo></mover>",
    "sqrt": lambda inner: f"<msqrt>{inner}</msqrt>",
    "ceil": lambda inner: f"<mo>⌈</mo>{inner}<mo>⌉</mo>",
}
_LIMITS = ("sum", "product")  # what stands above and below these when displayed


class _Piece(NamedTuple):
    """A part as MathML, and, where it is a group in parentheses, what these hold."""

    mathml: str
    inner: str = ""

    @property
    def bare(self) -> str:
        """Without parentheses, as Typst sets what is above or below a fraction's line, or attached."""
        return f"<mrow>{self.inner or self.mathml}</mrow>"


def mathml(source: str) -> str:
    """The formula as a `math` element, displayed. HarnessError for a notation that is not read."""
    reader = _Reader(source)
    inner = reader.row(until="")
    return f'<math display="block">{inner}</math>'


class _Reader:
    """Reads a formula from left to right."""

    def __init__(self, source: str) -> None:
        self.source, self.tokens, at = source, list[str](), 0
        text = source.rstrip()
        while at < len(text):
            found = _TOKEN.match(text, at)
            if found is None:
                raise self.error(f"'{text[at:].strip()[:8]}'")
            self.tokens.append(found[1])
            at = found.end()
        self.tokens.append("")

    def error(self, found: str) -> HarnessError:
        return HarnessError(f"the formula '{self.source}' holds {found}, which the HTML page cannot set; "
                            f"{__name__} says what it reads")

    def take(self) -> str:
        return self.tokens.pop(0)

    def row(self, until: str) -> str:
        """Everything up to a closing token, which is taken as well."""
        parts = []
        while self.tokens[0] != until:
            if self.tokens[0] in ("", ")"):
                raise self.error("parentheses that do not match")
            parts.append(self.fraction())
        self.take()
        return "".join(parts)

    def fraction(self) -> str:
        piece = self.attached()
        while self.tokens[0] == "/":
            self.take()
            piece = _Piece(f"<mfrac>{piece.bare}{self.attached().bare}</mfrac>")
        return piece.mathml

    def attached(self) -> _Piece:
        base = self.tokens[0]
        piece = self.atom()
        scripts = {"_": "", "^": ""}
        while self.tokens[0] in ("_", "^"):
            mark = self.take()
            scripts[mark] = self.atom().bare
        below, above = scripts["_"], scripts["^"]
        kind = ("under", "over") if base in _LIMITS else ("sub", "sup")
        name = "m" + (kind[0] if below else "") + (kind[1] if above else "")
        return piece if name == "m" else _Piece(f"<{name}><mrow>{piece.mathml}</mrow>{below}{above}</{name}>")

    def atom(self) -> _Piece:
        token = self.take()
        if token == "(":
            inner = self.row(until=")")
            return _Piece(f"<mrow><mo>(</mo>{inner}<mo>)</mo></mrow>", inner)
        if token.startswith('"'):
            return _Piece(f"<mtext>{escape(token[1:-1])}</mtext>")
        if token[:1].isdigit():
            return _Piece(f"<mn>{token}</mn>")
        if token in _SPACES:
            return _Piece(f'<mspace width="{_SPACES[token]}"/>')
        if token in _WRAPPED and self.tokens[0] == "(":
            self.take()
            return _Piece(f"<mrow>{_WRAPPED[token](self.row(until=')'))}</mrow>")
        if token in _NAMED:
            return _Piece(f"<mi>{token}</mi>")
        if token in _GREEK or (len(token) == 1 and token.isalpha()):
            return _Piece(f"<mi>{_GREEK.get(token, token)}</mi>")
        if token in _OPERATORS or token in ("+", "=", ",", "<", ">", "|"):
            return _Piece(f"<mo>{escape(_OPERATORS.get(token, token))}</mo>")
        raise self.error(f"'{token}'" if token else "nothing where something must stand")
