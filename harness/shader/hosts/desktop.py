"""Plain fragment shaders for OpenGL on the desktop, whose host is somebody's own program."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from harness.errors import ShaderError
from harness.shader.contract import Channel, Contract
from harness.shader.declarations import Declarations, declarations, entry
from harness.shader.hosts.reading import Answers, Dialect, Frame, Given, make_contract, make_pass
from harness.shader.hosts.written import written_size
from harness.shader.includes import Piece, joined
from harness.shader.language import GRATIN, Language, said_version

_MAIN = re.compile(r"\bvoid\s+main\s*\(")
_POSITION = re.compile(r"\bgl_Position\b")
_FEEDBACK = re.compile(r"uniform\s+(?:\w+\s+)?sampler2D\b")


def holds(files: Sequence[Given]) -> bool:
    """Any file with a `main`."""
    return any(_MAIN.search(file.bare) for file in files)


def read(files: Sequence[Given], answers: Answers) -> Contract:
    """One fragment shader, with the vertex shader to it if one is named."""
    pieces = [file.piece for file in files]
    return contract_of(pieces, "desktop", GRATIN, answers)


def contract_of(pieces: Sequence[Piece], host: str, otherwise: Language, answers: Answers,
                channels: Mapping[str, Channel] = MappingProxyType({})) -> Contract:
    """The contract of the fragment shader among these texts; `otherwise`: its language if it says none; `channels`:
    what samplers read, where the host's program says so."""
    fragment, vertex = chosen(pieces, answers)
    source = joined([fragment], {**otherwise.macros})
    version, note = said_version(source)
    answers.note(note)
    language = version or otherwise
    if version and version.macros != otherwise.macros:
        source = joined([fragment], language.macros)
    found = declarations(source, language.macros)
    entry(source, found)
    frame = Frame(language, channels=channels, zero=language.es, vertex=vertex, lines=_three(found, language))
    made = make_pass("main", source, frame, answers)
    asks = any(role in ("resolution", "width", "height", "aspect") for _, role in made.roles)
    size = None if asks or "textureSize" in found.names else written_size(source.text)
    if size:
        answers.note(f"{fragment.name}: the size of its image, {size[0]} x {size[1]}, is written into it")
    return make_contract(host, [made], answers, size)


def chosen(pieces: Sequence[Piece], answers: Answers) -> tuple[Piece, Piece | None]:
    """The fragment shader that traces paths, and the vertex shader to it.

    Of several fragment shaders, the longest of those that read a texture; what is left out is said in a note.
    """
    mains = [piece for piece in pieces if _MAIN.search(piece.text)]
    fragments = [piece for piece in mains if not _POSITION.search(piece.text)]
    if not fragments:
        raise ShaderError(f"{pieces[0].name}:1: no fragment shader with void main() in it; name the file that holds it")
    best = max(fragments, key=lambda piece: (bool(_FEEDBACK.search(piece.text)), len(piece.text.split())))
    for piece in fragments:
        if piece is not best:
            answers.note(f"{piece.name}:{_line(piece)}: another fragment shader, which is left out; name the one to be "
                         f"judged alone if it is not that of line {_line(best)}")
    wanted = set(re.findall(r"\b(?:varying|in)\s+(?:\w+\s+)?\w+\s+(\w+)\s*;", best.text))
    vertices = [piece for piece in mains if _POSITION.search(piece.text)
                and wanted <= set(re.findall(r"\w+", piece.text))]
    return best, vertices[0] if vertices and wanted else None


def _line(piece: Piece) -> int:
    """The line at which a text begins: texts from pages have empty lines before them."""
    return len(piece.text) - len(piece.text.lstrip("\n")) + 1


def _three(found: Declarations, language: Language) -> list[str]:
    """What three.js declares before a shader of ES, of what the text names."""
    names = {"cameraPosition": "vec3", "viewMatrix": "mat4"} if language.es else {}
    return [f"uniform {kind} {name};" for name, kind in names.items()
            if name in found.names and name not in found.declared]


DIALECT = Dialect("desktop", "a fragment shader for OpenGL", holds, read)
