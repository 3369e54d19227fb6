"""WebGL: GLSL ES 1.00 and 3.00 as files, in script tags of a page, or in strings of a script."""

from __future__ import annotations

import base64
import binascii
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import HarnessError, ShaderError
from harness.shader.contract import Channel, Contract
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
# The images in a page of ours (shader/exports/page.html), on a line of its own.
_IMAGES = re.compile(r"^const IMAGES = (\[.*\]);$", re.MULTILINE)
_IMAGE: Mapping[str, Callable[[Any], Any]] = {
    "width": abs, "height": abs, "channels": abs, "nearest": bool, "repeats": lambda pair: (pair[0], pair[1]),
    "texels": str}
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
    channels = {name: Channel(name, f"file:{file.path}#{name}", linear=not image["nearest"], repeat=image["repeats"][0])
                for file in files for name, image in _embedded(file.text, file.name).items()}
    return contract_of(pieces, "webgl", GLES_300 if newer else GLES_100, answers, channels)


def embedded_image(path: Path, name: str) -> np.ndarray:
    """The image that an exported page holds for a sampler, (H, W, 4) float32, in the order in which GL takes it.
    HarnessError for a page that has none of that name, or one that is damaged."""
    image = _embedded(path.read_text(encoding="utf-8", errors="replace"), path.name).get(name)
    if image is None:
        raise HarnessError(f"{path}: no image '{name}' in it; export the scene again")
    shape = image["height"], image["width"], image["channels"]
    try:
        data = np.frombuffer(base64.b64decode(image["texels"], validate=True), "<f4").reshape(shape)
        return np.dstack([data, np.ones((*shape[:2], 4), np.float32)])[..., :4].astype(np.float32)
    except (binascii.Error, ValueError, TypeError) as error:
        raise HarnessError(f"{path}: the image '{name}' is damaged ({error}); export the scene again") from None


def _embedded(text: str, name: str) -> Mapping[str, Mapping[str, Any]]:
    """The images in a page of ours, by their samplers; none where a page has none, or others' of that name."""
    found = _IMAGES.search(text)
    try:
        images = json.loads(found[1]) if found else []
        return {image["sampler"]: {key: kind(image[key]) for key, kind in _IMAGE.items()} for image in images}
    except (ValueError, LookupError, TypeError) as error:
        raise ShaderError(f"{name}:{text.count(chr(10), 0, found.start()) + 1 if found else 1}: the images in it are "
                          f"damaged ({error}); export the scene again") from None


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
