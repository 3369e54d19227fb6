"""A shader as a person reads it: one text, a section for each library file, and only what is used."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

from harness.shader.exports.chosen import Line, chosen

_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
_WORD = re.compile(r"[A-Za-z_]\w*")
_LAYOUT = re.compile(r"^\s*layout\s*\([^)]*\)")
_NESTED = re.compile(r"\([^()]*\)|\[[^][]*\]|\{[^{}]*\}")
_PROTOTYPE = re.compile(r"\s*\w+\s+\w+\s*\([^(){}]*\)\s*;\s*")
# A comment of one file ends at its first line of code; one of the next declaration stands directly above it.
_BLANK = ""


@dataclass(frozen=True)
class Item:
    """A declaration, a function or a macro of one file, with the comment that stands directly above it.

    `names`: what it declares; `words`: all identifiers in it.
    """

    file: str
    comment: str
    code: str
    names: frozenset[str]
    words: frozenset[str]


@dataclass(frozen=True)
class Text:
    """A shader in pieces: what each file says of itself, by name, and its items, in order."""

    about: dict[str, str]
    items: tuple[Item, ...]

    def only(self, roots: Collection[str]) -> Text:
        """What the items that declare one of `roots` need, directly or not."""
        needed, wanted = set[str](), set(roots)
        while wanted - needed:
            needed |= wanted
            wanted = {word for item in self.items if item.names & needed for word in item.words}
        return Text(self.about, tuple(item for item in self.items if item.names & needed))

    def without_prototypes(self) -> Text:
        """The same with each function defined before it is called, for compilers that know no prototypes."""
        left = [item for item in self.items if not _PROTOTYPE.fullmatch(_COMMENT.sub(" ", item.code))]
        if len(left) == len(self.items):
            return self
        ordered: list[Item] = []
        while left:
            missing = {name for item in left for name in item.names}
            # The first that waits for none but itself; where things go round in a circle, as no GLSL does, the first.
            ready = next((item for item in left if not item.words & missing - item.names), left[0])
            ordered.append(ready)
            left.remove(ready)
        return Text(self.about, tuple(ordered))

    def written(self) -> str:
        """As GLSL: a heading and what the file says of itself before its first item; ends in a newline."""
        lines: list[str] = []
        file, told = None, set[str]()
        previous = ""
        for item in self.items:
            if item.file != file:
                file = item.file
                lines += [_BLANK, f"// ==== {file} {'=' * max(0, 110 - len(file))}"]
                if file not in told and (about := self.about.get(file)):
                    lines += [about]
                told.add(file)
                lines.append(_BLANK)
            elif item.comment or "\n" in item.code or "\n" in previous:
                lines.append(_BLANK)
            lines += [*([item.comment] if item.comment else []), item.code]
            previous = item.code
        return "\n".join(lines).strip("\n") + "\n"


def split(text: str) -> Text:
    """An assembled shader (harness/shader/source.py) in pieces, its conditionals decided."""
    about: dict[str, str] = {}
    items: list[Item] = []
    for comment, block in _blocks(chosen(text)):
        file = block[0].file if block else comment[0].file
        said = "\n".join(line.text for line in comment)
        if not block:
            about.setdefault(file, said)
            continue
        code = "\n".join(line.text for line in block)
        items.append(item(file, code, said))
    return Text(about, tuple(items))


def item(file: str, code: str, comment: str = "") -> Item:
    """One declaration, function or macro."""
    bare = _COMMENT.sub(" ", code)
    return Item(file, comment, code, frozenset(_declared(bare)), frozenset(_WORD.findall(bare)))


def _blocks(lines: Sequence[Line]) -> Iterator[tuple[list[Line], list[Line]]]:
    """(comment, code) of each item; code is empty for a comment that stands by itself, as a file's first one does."""
    comment: list[Line] = []
    code: list[Line] = []
    depth = 0
    for line in lines:
        bare = _COMMENT.sub(" ", line.text).strip()
        if comment and (line.file != comment[-1].file or (not code and not line.text.strip())):
            yield comment, []
            comment = []
        if not code and not bare:
            if line.text.strip():
                comment.append(line)
            continue
        code.append(line)
        depth += sum(bare.count(mark) for mark in "({[") - sum(bare.count(mark) for mark in ")}]")
        if depth == 0 and (bare.endswith((";", "}")) or bare.startswith("#")):
            if bare == "}" and code[0].text.startswith("struct"):
                continue  # its semicolon comes yet
            yield comment, code
            comment, code = [], []
    if comment or code:
        yield comment, code


def _declared(code: str) -> Iterable[str]:
    """The names that an item without comments gives."""
    words = code.split()
    if words[0] == "#define":
        return [words[1].partition("(")[0]]
    if words[0] == "struct":
        return [words[1]]
    if words[0].startswith("#") or words[0] == "precision":
        return ["main"]  # belongs to every shader
    declaration = _LAYOUT.sub("", code)
    head = declaration.partition("{")[0].partition("=")[0]
    if function := re.match(r"\s*(?:\w+\s+)+(\w+)\s*\(", head):
        return [function[1]]
    flat = declaration.strip().rstrip(";")
    while (shorter := _NESTED.sub(" ", flat)) != flat:
        flat = shorter
    return [declarator.partition("=")[0].split()[-1] for declarator in flat.split(",")]
