"""A stranger's files joined into one text: comments gone, lines numbered, includes taken only from their own folder."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from harness.errors import ShaderError
from harness.shader.conditionals import preprocess
from harness.shader.decoding import MAX_BYTES, decoded
from harness.shader.lexer import hidden, without_comments
from harness.shader.source import LINE_STRIDE, ShaderSource

_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include\b[ \t]*(?P<what>[^\n]*)', re.MULTILINE)
_QUOTED = re.compile(r'"([^"]*)"\s*$')
_LINE = re.compile(r"^[ \t]*#[ \t]*line\b[^\n]*", re.MULTILINE)
_GUARD = re.compile(r"\s*#[ \t]*(?:pragma[ \t]+once\b|ifndef[ \t]+(\w+)[^\n]*\n\s*#[ \t]*define[ \t]+\1\b)")


@dataclass(frozen=True)
class Piece:
    """A text of somebody's: `name`: what messages call it; `folder`: where its includes are looked up, if anywhere.

    `shown`: the author's lines, which messages show, where `text` has others.
    """

    name: str
    text: str
    folder: Path | None = None
    shown: str = ""


def joined(pieces: Sequence[Piece], defines: Mapping[str, str] | None = None) -> ShaderSource:
    """The texts one after another, each with what it includes; every line numbered as LINE_STRIDE says.

    An include is taken from the folder of the file that names it, never from outside the folder of the piece, and once.
    Those that the preprocessor leaves out where `defines` are defined are left out. No comment, no `#include` and no
    `#line` of the author's remains.

    Raises ShaderError, with file and line, for an include that does not exist, climbs out, or includes itself.
    """
    join = _Join(dict(defines or {}))
    for piece in pieces:
        join.add(piece.name, piece.text, piece.folder, piece.folder, (piece.name,), piece.shown)
    return ShaderSource("".join(join.output), tuple(join.files))


@dataclass
class _Join:
    defines: dict[str, str]
    files: list[tuple[str, str]] = field(default_factory=list)
    output: list[str] = field(default_factory=list)
    taken: set[Path] = field(default_factory=set)
    size: int = 0

    def add(self, name: str, text: str, folder: Path | None, root: Path | None, chain: tuple[str, ...],
            shown: str = "") -> None:
        self.files.append((name, shown or text))
        self.size += len(text)
        number = len(self.files)
        if self.size > MAX_BYTES:
            raise ShaderError(f"{name}:1: with its includes the shader has more than {MAX_BYTES >> 20} MB; a shader is "
                              "a few thousand lines, take tables of data out of it")
        bare = _LINE.sub(lambda found: hidden(found[0]), without_comments(text, name))
        self._number(number, 1)
        done = 0
        for found in _INCLUDE.finditer(bare):
            self.output.append(bare[done:found.start()])
            done = found.end()
            line = bare.count("\n", 0, found.start()) + 1
            if self._keeps():
                self._include(f"{name}:{line}", found["what"], folder, root, chain)
                self._number(number, line)
        self.output += [bare[done:], "" if bare.endswith("\n") else "\n"]

    def _keeps(self) -> bool:
        """Whether the preprocessor keeps what would follow now."""
        return preprocess("".join([*self.output, "\nx"]), self.defines).text.endswith("x")

    def _number(self, file: int, line: int) -> None:
        start = "" if not self.output or self.output[-1].endswith("\n") else "\n"
        self.output.append(f"{start}#line {file * LINE_STRIDE + line} {file - 1}\n")

    def _include(self, at: str, what: str, folder: Path | None, root: Path | None, chain: tuple[str, ...]) -> None:
        quoted = _QUOTED.match(what.strip())
        if not quoted:
            raise ShaderError(f"{at}: '#include {what.strip()}' is a piece of its own program; put its text here")
        if folder is None or root is None:
            raise ShaderError(f'{at}: an include, "{quoted[1]}", in a text that is no file; put its text here')
        target = (folder / quoted[1].replace("\\", "/")).resolve()
        if not target.is_relative_to(root.resolve()):
            raise ShaderError(f'{at}: the include "{quoted[1]}" leads out of the folder of the shader; copy the file '
                              "into that folder")
        if not target.is_file():
            raise ShaderError(f'{at}: no such file "{quoted[1]}" in the folder of the shader; put it there')
        shown = str(folder / quoted[1])
        if shown in chain or any(target.samefile(name) for name in chain if Path(name).is_file()):
            if _GUARD.match(without_comments(decoded(target).text, shown)):
                return
            raise ShaderError(f'{at}: "{quoted[1]}" includes itself ({" > ".join(Path(name).name for name in chain)} > '
                              f"{target.name}); guard it with #ifndef")
        if target not in self.taken:
            self.taken.add(target)
            self.add(shown, decoded(target).text, target.parent, root, (*chain, shown))
