"""What WebGL promises and desktop GLSL does not: every variable starts at zero. A source pass that keeps lines.

One in five public path tracers on Shadertoy draws another picture without it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from harness.shader.conditionals import preprocess
from harness.shader.declarations import PRECISIONS
from harness.shader.lexer import Token, closing, tokens

ZEROS = {"float": "0.0", "int": "0", "uint": "0u", "bool": "false"}
for _n in "234":
    ZEROS |= {f"vec{_n}": f"vec{_n}(0.0)", f"ivec{_n}": f"ivec{_n}(0)", f"uvec{_n}": f"uvec{_n}(0u)",
              f"bvec{_n}": f"bvec{_n}(false)", f"mat{_n}": f"mat{_n}(0.0)"}
    ZEROS |= {f"mat{_n}x{_m}": f"mat{_n}x{_m}(0.0)" for _m in "234"}
# What begins a declaration that needs no zero, or must not have one. An `out` of the shader is told apart.
_OTHERS = frozenset({"const", "uniform", "in", "inout", "varying", "attribute", "buffer", "shared", "layout",
                     "precision", "return", "invariant"})


@dataclass(frozen=True)
class _Member:
    kind: str
    name: str
    sizes: tuple[str, ...]


@dataclass
class _Types:
    """The zero of each type, and the members of structures."""

    macros: Mapping[str, str]
    structures: dict[str, list[_Member]] = field(default_factory=dict)

    def known(self, kind: str) -> str:
        """The type that a name stands for, '' for none."""
        kind = self.macros.get(kind, kind)
        return kind if kind in ZEROS or kind in self.structures else ""

    def expression(self, kind: str) -> str:
        """A zero of this type; '' where only statements make one: a structure that holds an array."""
        if kind in ZEROS:
            return ZEROS[kind]
        parts = ["" if member.sizes else self.expression(member.kind) for member in self.structures[kind]]
        return f"{kind}({', '.join(parts)})" if parts and all(parts) else ""

    def statements(self, kind: str, name: str, sizes: tuple[str, ...], depth: int = 0) -> str:
        """Statements, in one line, that make a variable zero."""
        if sizes:
            index = f"zero_{depth}_"
            inner = self.statements(kind, f"{name}[{index}]", sizes[1:], depth + 1)
            return f"for (int {index} = 0; {index} < int({sizes[0]}); ++{index}) {{ {inner} }}"
        if zero := self.expression(kind):
            return f"{name} = {zero};"
        return " ".join(self.statements(member.kind, f"{name}.{member.name}", member.sizes, depth)
                        for member in self.structures[kind])


def zero_initialised(text: str, defines: Mapping[str, str] | None = None) -> str:
    """A text without comments (harness/shader/includes.py), with zeros for all variables that it gives no value.

    Locals, globals, structures, arrays, `out` parameters and the outputs of the shader; of lines that are kept where
    `defines` hold. What macros declare is left as it is. Its lines stay where they are.
    """
    seen = preprocess(text, defines)
    found = tokens(seen.text)
    edits, late = _Reader(found, _Types(seen.macros)).edits()
    names = {token.text for token in found}
    entry = _entry(found, "main") or _entry(found, "mainImage")
    if entry is not None and ("gl_FragColor" in names and "gl_FragData" not in names):
        late.insert(0, "gl_FragColor = vec4(0.0);")
    if entry is not None and late:
        edits.append((found[entry].end, " " + " ".join(late)))
    parts, done = [], 0
    for at, what in sorted(edits, key=lambda edit: edit[0]):
        parts += [text[done:at], what]
        done = at
    return "".join([*parts, text[done:]])


def _entry(found: Sequence[Token], name: str) -> int | None:
    """The token that opens the body of a function."""
    for index in range(len(found) - 3):
        if found[index].text == "void" and found[index + 1].text == name and found[index + 2].text == "(":
            end = closing(found, index + 2)
            if end + 1 < len(found) and found[end + 1].text == "{":
                return end + 1
    return None


class _Reader:
    """Goes through the tokens once and collects what to write where."""

    def __init__(self, found: Sequence[Token], types: _Types) -> None:
        self._tokens, self._types = found, types
        self._edits: list[tuple[int, str]] = []
        self._late: list[str] = []  # for globals, at the beginning of the entry function
        self._depth = 0

    def edits(self) -> tuple[list[tuple[int, str]], list[str]]:
        index = 0
        while index < len(self._tokens):
            text = self._text(index)
            if self._starts(index) and (after := self._declaration(index)):
                index = after
                continue
            if text == "struct":  # that of a constant or a uniform
                index = self._structure(index, named=False)
                continue
            self._depth += {"{": 1, "}": -1}.get(text, 0)
            index += 1
        return self._edits, self._late

    def _text(self, index: int) -> str:
        return self._tokens[index].text if 0 <= index < len(self._tokens) else ""

    def _starts(self, index: int) -> bool:
        before = self._text(index - 1)
        return before in ("", ";", "{", "}", ":") or (before == "(" and self._text(index - 2) == "for")

    def _declaration(self, index: int) -> int:
        """Read the declaration that begins here; the index behind it, 0 where there is none."""
        output, in_for = False, self._text(index - 1) == "("
        while self._text(index) in PRECISIONS or self._text(index) in ("out", "layout", "flat", "highp", "precise"):
            if self._text(index) == "layout":
                index = closing(self._tokens, index + 1)
            output = output or self._text(index) == "out"
            index += 1
        text = self._text(index)
        if text in _OTHERS:
            return 0
        if text == "struct":
            return self._structure(index)
        kind = self._types.known(text)
        after, sizes = self._sizes(index + 1)
        if after >= len(self._tokens) or self._tokens[after].kind != "name":
            return 0
        if self._text(after + 1) == "(" and self._depth == 0:
            return self._function(after + 1)
        return self._declarators(after, kind, sizes, output, in_for) if kind else 0

    def _sizes(self, index: int) -> tuple[int, tuple[str, ...]]:
        """The sizes in square brackets from here on, and the index behind them."""
        sizes: list[str] = []
        while self._text(index) == "[":
            end = closing(self._tokens, index)
            sizes.append(" ".join(token.text for token in self._tokens[index + 1:end]))
            index = end + 1
        return index, tuple(sizes)

    def _declarators(self, index: int, kind: str, sizes: tuple[str, ...], output: bool = False,
                     in_for: bool = False) -> int:
        """Names from `index` on, up to their `;`. An array in the head of a loop has no place for its zeros."""
        after: list[str] = []
        while index < len(self._tokens) and self._tokens[index].kind == "name":
            name = self._text(index)
            end, own = self._sizes(index + 1)
            last, whole = self._tokens[end - 1].end, own + sizes
            if self._text(end) in (",", ";"):
                if output:
                    self._late.append(self._types.statements(kind, name, whole))
                elif not whole and (zero := self._types.expression(kind)):
                    self._edits.append((last, f" = {zero}"))
                elif all(whole):
                    after.append(self._types.statements(kind, name, whole))
            index = end
            while index < len(self._tokens) and self._text(index) not in (",", ";"):
                if self._text(index) == ")":
                    return index  # it was no declaration
                index = closing(self._tokens, index) + 1 if self._text(index) in ("(", "[", "{") else index + 1
            if self._text(index) == ";":
                break
            index += 1
        if after and self._depth == 0:
            self._late += after
        elif after and not in_for and index < len(self._tokens):
            self._edits.append((self._tokens[index].end, " " + " ".join(after)))
        return index

    def _structure(self, index: int, named: bool = True) -> int:
        name = self._text(index + 1) if self._text(index + 1) != "{" else ""
        opening = index + (2 if name else 1)
        end = closing(self._tokens, opening)
        members = list(self._members(opening + 1, end))
        if name and all(members):
            self._types.structures[name] = [member for member in members if member]
        if named and name in self._types.structures and self._text(end + 1) != ";":
            return self._declarators(end + 1, name, ())
        return end + 1

    def _members(self, index: int, end: int) -> Iterator[_Member | None]:
        """The members of a structure; None for one whose type has no zero."""
        while index < end:
            while self._text(index) in PRECISIONS:
                index += 1
            kind = self._types.known(self._text(index))
            index, sizes = self._sizes(index + 1)
            while index < end and self._text(index) != ";":
                name = self._text(index)
                index, own = self._sizes(index + 1)
                yield _Member(kind, name, own + sizes) if kind else None
                index += self._text(index) == ","
                if self._tokens[index].kind != "name" and self._text(index) != ";":
                    return
            index += 1

    def _function(self, opening: int) -> int:
        """Zeros for the `out` parameters of a definition; the index at which its body opens, or behind a prototype."""
        end = closing(self._tokens, opening)
        if self._text(end + 1) != "{":
            return end + 1
        zeros: list[str] = []
        begin = opening + 1
        for index in range(opening + 1, end + 1):
            if self._text(index) == "," or index == end:
                zeros += self._parameter(begin, index)
                begin = index + 1
        if zeros:
            self._edits.append((self._tokens[end + 1].end, " " + " ".join(zeros)))
        return end + 1

    def _parameter(self, index: int, end: int) -> list[str]:
        words = [self._text(at) for at in range(index, end)]
        if "out" not in words:
            return []
        while self._text(index) in PRECISIONS or self._text(index) == "out":
            index += 1
        kind = self._types.known(self._text(index))
        after, sizes = self._sizes(index + 1)
        if not kind or after >= end or self._tokens[after].kind != "name":
            return []
        _, own = self._sizes(after + 1)
        return [self._types.statements(kind, self._text(after), own + sizes)]
