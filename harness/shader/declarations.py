"""What a stranger's text declares: uniforms with their types, what comes from the vertex shader, functions."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

from harness.errors import ShaderError
from harness.shader.conditionals import preprocess
from harness.shader.contract import Declared
from harness.shader.lexer import Token, closing, place, tokens
from harness.shader.source import ShaderSource

PRECISIONS = frozenset({"highp", "mediump", "lowp"})
_QUALIFIERS = PRECISIONS | {"flat", "smooth", "noperspective", "centroid", "invariant", "precise", "coherent",
                            "volatile", "restrict", "readonly", "writeonly"}
MAX_PARTS = 512
BASIC = re.compile(r"(?:float|int|uint|bool|double|[iubd]?vec[234]|mat[234](?:x[234])?|[iu]?sampler\w+|[iu]?image\w+|"
                   r"atomic_uint)$")


@dataclass(frozen=True)
class Varying:
    """What a fragment shader takes from the vertex shader; `layout`: 'layout(…) ' where it says one."""

    kind: str
    name: str
    where: str
    layout: str = ""
    flat: bool = False


@dataclass(frozen=True)
class Constant:
    """A constant outside of functions, and from where to where in the text its value stands."""

    one: Declared
    start: int
    end: int


@dataclass
class Declarations:
    """Of one text: `uniforms`, `varyings`, `constants`, `outputs` (type, name) and `functions` (name, and where each is
    defined).

    `declared`: every name that a declaration outside of functions gives. `names`: how often each name occurs, in
    macros too.
    """

    uniforms: list[Declared] = field(default_factory=list)
    varyings: list[Varying] = field(default_factory=list)
    constants: list[Constant] = field(default_factory=list)
    outputs: list[tuple[str, str]] = field(default_factory=list)
    functions: dict[str, list[str]] = field(default_factory=dict)
    declared: set[str] = field(default_factory=set)
    names: dict[str, int] = field(default_factory=dict)


def declarations(source: ShaderSource, defines: Mapping[str, str] | None = None, vertex: bool = False) -> Declarations:
    """Everything declared outside of functions in a joined text (harness/shader/includes.py), where `defines` hold.

    `vertex`: the text is a vertex shader, whose `in` are attributes (they are told as varyings are).
    Raises ShaderError, with file and line, for storage that only its own program can fill. It is remembered:
    leave it as it is.
    """
    return _declarations(source, tuple(sorted((defines or {}).items())), vertex)


@lru_cache(maxsize=16)
def _declarations(source: ShaderSource, defines: tuple[tuple[str, str], ...], vertex: bool) -> Declarations:
    found = Declarations()
    for name in re.findall(r"[A-Za-z_]\w*", source.text):
        found.names[name] = found.names.get(name, 0) + 1
    seen = preprocess(source.text, dict(defines))
    structures: dict[str, list[tuple[str, str, int]]] = {}
    for statement in _statements(tokens(seen.text)):
        _Statement(source, statement, seen.macros, structures, vertex).read(found)
    return found


def _statements(found: Sequence[Token]) -> Iterator[Sequence[Token]]:
    """The tokens of each declaration at the outermost level, up to its `;`, or to the `{` of a function."""
    start = index = 0
    while index < len(found):
        text = found[index].text
        if text in "([":
            index = closing(found, index)
        elif text == "{" and index > start and found[index - 1].text == ")":
            yield found[start:index + 1]
            index = start = closing(found, index)
            start += 1
        elif text == "{":
            index = closing(found, index)
        elif text == ";":
            yield found[start:index + 1]
            start = index + 1
        index += 1


class _Declarator(NamedTuple):
    """A declared name: its token, the size of an array, whether it has a value, and from where to where that stands."""

    token: Token
    size: int
    initialised: bool
    value: tuple[int, int] | None


class _Statement:
    def __init__(self, source: ShaderSource, found: Sequence[Token], macros: Mapping[str, str],
                 structures: dict[str, list[tuple[str, str, int]]], vertex: bool) -> None:
        self._source, self._tokens, self._macros, self._structures = source, found, macros, structures
        self._vertex = vertex
        self._at = 0

    def read(self, found: Declarations) -> None:
        layout, storage, flat = "", "", False
        while self._at < len(self._tokens):
            text = self._tokens[self._at].text
            if text == "layout" and self._text(1) == "(":
                end = closing(self._tokens, self._at + 1)
                layout = "layout(" + " ".join(token.text for token in self._tokens[self._at + 2:end]) + ") "
                self._at = end
            elif text in ("uniform", "in", "out", "varying", "attribute", "buffer", "const", "precision", "shared"):
                storage = text
            elif text in ("flat", "nointerpolation"):
                flat = True
            elif text not in _QUALIFIERS:
                break
            self._at += 1
        if self._at >= len(self._tokens) or storage == "precision":
            return
        if "local_size" in layout or storage in ("buffer", "shared"):
            self._refuse("storage buffers and compute shaders")
        if self._text() == "struct":
            self._structure(found, storage)
            return
        kind = self._type()
        if self._text() == "{" and storage:
            self._refuse(f"{'a block' if storage == 'uniform' else 'an interface block'}, '{kind}'")
        if self._text(1) == "(" and self._tokens[-1].text == "{":
            found.functions.setdefault(self._text(), []).append(place(self._source, self._tokens[self._at].start))
            found.declared.add(self._text())
            return
        self._names(found, storage, kind, layout, flat)

    def _refuse(self, what: str) -> None:
        token = self._tokens[min(self._at, len(self._tokens) - 1)]
        raise ShaderError(f"{place(self._source, token.start)}: {what}: only its own program knows what is in it; "
                          "write the data into the shader as constants, or as single uniforms")

    def _text(self, ahead: int = 0) -> str:
        return self._tokens[self._at + ahead].text if self._at + ahead < len(self._tokens) else ""

    def _type(self) -> str:
        kind = self._text()
        kind = self._macros.get(kind, kind) or kind
        self._at += 1
        return kind

    def _size(self) -> int:
        """The size in square brackets at this place, 0 for none, -1 for one that is not a number."""
        size = 0
        while self._text() == "[":
            end = closing(self._tokens, self._at)
            inside = " ".join(token.text for token in self._tokens[self._at + 1:end])
            inside = self._macros.get(inside, inside).rstrip("u")
            size = int(inside) if inside.isdecimal() and len(inside) < 7 else -1
            self._at = end + 1
        return size

    def _structure(self, found: Declarations, storage: str) -> None:
        self._at += 1
        name = self._text() if self._text() != "{" else ""
        self._at += bool(name)
        end = closing(self._tokens, self._at)
        members: list[tuple[str, str, int]] = []
        inner, self._at = self._tokens[self._at + 1:end], end + 1
        for statement in _statements(inner):
            part = _Statement(self._source, statement, self._macros, self._structures, self._vertex)
            while part._text() in _QUALIFIERS:
                part._at += 1
            kind = part._type()
            members += [(kind, each.token.text, each.size) for each in part._declarators()]
        # Nobody writes structures within structures of more members than this; their uniforms stay whole.
        self._structures[name] = members if sum(self._parts(kind) for kind, _, _ in members) <= MAX_PARTS else []
        if self._text() != ";":
            self._names(found, storage, name, "", False)

    def _parts(self, kind: str) -> int:
        """The members of a structure, with those of the structures within it and itself; 1 of any other type."""
        if kind not in self._structures:
            return 1
        members = self._structures[kind]
        return 1 + sum(self._parts(inner) for inner, _, _ in members) if members else MAX_PARTS

    def _declarators(self) -> Iterator[_Declarator]:
        """Each name that follows."""
        first = self._size()
        while self._at < len(self._tokens) and self._tokens[self._at].kind == "name":
            token = self._tokens[self._at]
            self._at += 1
            size = self._size() or first
            first_of_value = self._at + 1 if self._text() == "=" else None
            while self._at < len(self._tokens) and self._text() not in (",", ";"):
                self._at = closing(self._tokens, self._at) + 1 if self._text() in ("(", "[", "{") else self._at + 1
            value = None
            if first_of_value is not None and first_of_value < self._at <= len(self._tokens):
                value = self._tokens[first_of_value].start, self._tokens[self._at - 1].end
            self._at += 1
            yield _Declarator(token, size, first_of_value is not None, value)

    def _names(self, found: Declarations, storage: str, kind: str, layout: str, flat: bool) -> None:
        for token, size, initialised, value in self._declarators():
            name = token.text
            found.declared.add(name)
            where = place(self._source, token.start)
            if storage == "uniform":
                if re.match(r"[iu]?image|atomic_uint", kind):
                    self._refuse(f"an {kind}, '{name}'")
                found.uniforms += self._members(kind, name, where, size, initialised)
            elif storage == "const" and value is not None:
                found.constants.append(Constant(Declared(name, kind, where, max(size, 0) or (1 if size else 0), True),
                                                *value))
            elif storage in ("attribute", "in") if self._vertex else storage in ("varying", "in"):
                found.varyings.append(Varying(kind, name, where, layout, flat))
            elif storage == "out":
                found.outputs.append((kind, name))

    def _members(self, kind: str, name: str, where: str, size: int, initialised: bool) -> Iterator[Declared]:
        """One uniform, or the members of one that is a structure."""
        if BASIC.match(kind) or not self._structures.get(kind) or size:
            yield Declared(name, kind or "struct", where, max(size, 0) or (1 if size else 0), initialised)
            return
        for inner, member, count in self._structures[kind]:
            yield from self._members(inner, f"{name}.{member}", where, count, initialised)


def entry(source: ShaderSource, found: Declarations) -> str:
    """`main` or `mainImage`, whichever the text defines. ShaderError where it defines neither, or one of them twice."""
    for name in ("main", "mainImage"):
        places = found.functions.get(name, [])
        if len(places) > 1:
            raise ShaderError(f"{places[1]}: a second {name}(), the first is at {places[0]}; name one shader, or one "
                              "file a pass")
        if places or re.search(rf"#[^\n]*\bvoid\s+{name}\s*\(", source.text):  # a macro may write it
            return name
    raise ShaderError(f"{source.files[0][0]}:1: no void main() and no void mainImage(); name the file that holds it")
