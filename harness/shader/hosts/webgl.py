"""WebGL: GLSL ES 1.00 and 3.00 as files, in script tags of a page, or in strings of a script."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from harness.errors import ShaderError
from harness.shader.contract import Contract
from harness.shader.hosts.desktop import contract_of
from harness.shader.hosts.reading import PAGES, SCRIPTS, Answers, Dialect, Given
from harness.shader.includes import Piece
from harness.shader.language import GLES_100, GLES_300

_TAG = re.compile(r"<script\b(?P<attributes>[^>]*)>(?P<text>.*?)</script\s*>", re.DOTALL | re.IGNORECASE)
_TEMPLATE = re.compile(r"`(?P<text>(?:\\.|[^`\\])*)`", re.DOTALL)
_RAW = re.compile(r'R"(?P<mark>\w*)\((?P<text>.*?)\)(?P=mark)"', re.DOTALL)
_STRING = re.compile(r"(?P<quote>[\"'])(?P<text>(?:\\.|(?!(?P=quote))[^\\\n])*)(?P=quote)")
_ESCAPES = {"n": "\n", "t": "\t", "r": ""}
_SLOT = re.compile(r"\$\{(?P<name>[^{}]*)\}?")
_MAIN = re.compile(r"\bvoid\s+main\s*\(")
_VERSION = re.compile(r"^[ \t]*#[ \t]*version\s+(\d+)\s*(es)?", re.MULTILINE)
_ES_100 = re.compile(r"\bgl_FragColor\b|\bvarying\b|\btexture2D\b|\bprecision\s+\w+\s+\w+\s*;")
_ES_300 = re.compile(r"\b(?:uint|uvec[234]|texelFetch|textureSize|floatBitsToUint|uintBitsToFloat|round|trunc|sinh|"
                     r"cosh|inverse|transpose)\s*\(|\buint\s+\w|\buvec[234]\s+\w|\bswitch\s*\(|\d[uU]\b|<<|>>|"
                     r"^[ \t]*(?:layout\s*\([^)]*\)\s*)?(?:in|out)\s+(?:\w+\s+)?\w+\s+\w+\s*;", re.MULTILINE)


def holds(files: Sequence[Given]) -> bool:
    """A page or a script with a shader in it, or a shader of ES."""
    return any(file.in_program or _is_es(file.bare) for file in files)


def read(files: Sequence[Given], answers: Answers) -> Contract:
    """The fragment shader, with the vertex shader to it if there is one."""
    pieces = [piece for file in files for piece in (shaders_in(file) if file.in_program else [file.piece])]
    if not pieces:
        raise ShaderError(f"{files[0].name}:1: no shader in it (no <script> of a shader's type and no string with void "
                          "main()); name the file that holds one")
    newer = any(_is_newer(_bare(piece.text)) for piece in pieces if "gl_Position" not in piece.text)
    return contract_of(pieces, "webgl", GLES_300 if newer else GLES_100, answers)


def _is_es(text: str) -> bool:
    if found := _VERSION.search(text):
        return found[1] == "100" or bool(found[2])
    return bool(_ES_100.search(text))


def _is_newer(text: str) -> bool:
    """Whether a text has what ES 3.00 brought; a function of that name may be the author's own, for 1.00."""
    words = {found[0].rstrip("( \t\n") for found in _ES_300.finditer(text)}
    return any(not re.search(rf"\b\w+\s+{re.escape(word)}\s*\([^;{{}}]*\)\s*\{{", text) for word in words)


def _bare(text: str) -> str:
    return re.sub(r"//[^\n]*|/\*.*?\*/", " ", text, flags=re.DOTALL)


def shaders_in(file: Given) -> list[Piece]:
    """The shaders in a page or a script, each with as many empty lines before it as stand before it in the file."""
    return [Piece(file.name, "\n" * file.text.count("\n", 0, start) + _filled(file, text, start), file.path.parent)
            for start, text in _texts(file) if _MAIN.search(text)]


def _texts(file: Given) -> Iterator[tuple[int, str]]:
    suffix = file.path.suffix.lower()
    if suffix in PAGES:
        for found in _TAG.finditer(file.text):
            if re.search(r"type\s*=\s*[\"']?[^\"'>]*(?:shader|glsl|vert|frag|x-)", found["attributes"], re.IGNORECASE):
                yield found.start("text"), found["text"]
    if suffix not in SCRIPTS:
        for found in _RAW.finditer(file.text):
            yield found.start("text"), found["text"]
    else:
        for found in _TEMPLATE.finditer(file.text):
            yield found.start("text"), found["text"]
    for found in _STRING.finditer(file.text):
        if "main" in found["text"]:
            plain = re.sub(r"\\(.)", lambda escape: _ESCAPES.get(escape[1], escape[1]), found["text"])
            yield found.start("text"), plain


def _filled(file: Given, text: str, start: int) -> str:
    """A template string with numbers in place of its slots, where the script says them as constants."""
    def fill(slot: re.Match[str]) -> str:
        name = slot["name"].strip()
        value = re.search(rf"\b(?:const|let|var)\s+{re.escape(name)}\s*=\s*(-?[\d.]+(?:e-?\d+)?)\s*[;,\n]", file.text)
        if not value:
            line = file.text.count("\n", 0, start + slot.start()) + 1
            raise ShaderError(f"{file.name}:{line}: only its program knows '{slot[0]}'; write its text into the "
                              "shader, or save the whole shader as a .frag file")
        return value[1]
    return _SLOT.sub(fill, text)


DIALECT = Dialect("webgl", "a shader for WebGL", holds, read)
