"""GLSL's versions: which one a text is in, which one the driver takes it in, and the lines that go before it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from harness.errors import ShaderError
from harness.shader.lexer import hidden, number_at, place
from harness.shader.source import ShaderSource
from harness.shader.zero_init import zero_initialised

_VERSION = re.compile(r"^[ \t]*#[ \t]*version\b[ \t]*(?P<number>\d*)[ \t]*(?P<profile>\w*)[^\n]*", re.MULTILINE)
_EXTENSION = re.compile(r"^[ \t]*#[ \t]*extension\b[^\n]*", re.MULTILINE)
_LOW = re.compile(r"\b(?:mediump|lowp)\b")
# The newest that Mesa 22 has, and the oldest with which all desktop drivers make a core context.
NEWEST, OLDEST = 450, 330
_ES = (100, 300, 310, 320)
# Mesa computes mediump in 16 bits, and int is mediump by default in fragment shaders: a loop's bound of 99999 wraps.
# Browsers on desktop machines compute it in 32.
_HIGH = "precision highp float; precision highp int; precision highp sampler2D; precision highp samplerCube;"
_HIGH_300 = (_HIGH + " precision highp sampler3D; precision highp sampler2DArray; precision highp isampler2D; "
             "precision highp usampler2D;")
_LOWERED = ("#define lowp highp", "#define mediump highp")
# What GLSL 1.30 and ES 3.00 called anew; `gl_FragColor` becomes an output of this name.
OUTPUT = "harness_color"
_RENAMED = {"varying": "in", "texture2D": "texture", "textureCube": "texture", "texture2DLod": "textureLod",
            "texture2DLodEXT": "textureLod", "textureCubeLodEXT": "textureLod", "texture2DProj": "textureProj",
            "texture2DGradEXT": "textureGrad", "texture3D": "texture"}

_OLD_WORD = re.compile(rf"\b(?:{'|'.join(_RENAMED)})\b")


@dataclass(frozen=True)
class Language:
    """A version of GLSL, on the desktop or (`es`) of OpenGL ES, which WebGL speaks."""

    number: int
    es: bool = False

    @property
    def line(self) -> str:
        """Its `#version` line."""
        if not self.es:
            return f"#version {self.number} core"
        return "#version 100" if self.number == 100 else f"#version {self.number} es"

    @property
    def old(self) -> bool:
        """Whether it has attribute, varying and gl_FragColor."""
        return self.es and self.number == 100

    @property
    def macros(self) -> dict[str, str]:
        """What it defines by itself."""
        es = {"GL_ES": "1", "GL_FRAGMENT_PRECISION_HIGH": "1"} if self.es else {}
        return {"__VERSION__": str(self.number), **es}


GLES_100, GLES_300, GRATIN = Language(100, True), Language(300, True), Language(420)


def said_version(source: ShaderSource) -> tuple[Language | None, str]:
    """The version that a text asks for, '' or a note where the driver takes it as another one.

    Raises ShaderError, with file and line, for a version that does not exist.
    """
    found = _VERSION.search(source.text)
    if not found:
        return None, ""
    number, es = int(found["number"] or "0"), found["profile"] == "es" or found["number"] == "100"
    at = place(source, found.start())
    if (es and number not in _ES) or (not es and (not 110 <= number <= 460 or number % 10)):
        raise ShaderError(f"{at}: '{found[0].strip()}' is no version of GLSL; write '#version 330 core' or "
                          "'#version 300 es'")
    if es:
        return Language(number, True), ""
    taken = min(max(number, OLDEST), NEWEST)
    if taken == number:
        return Language(number), ""
    return Language(taken), f"{at}: GLSL {number // 100}.{number % 100:02} is taken as {taken // 100}.{taken % 100:02}"


def complete(source: ShaderSource, language: Language, declares: Sequence[str] = (),
             defines: Mapping[str, str] | None = None, zero: bool = False, after: str = "") -> ShaderSource:
    """A joined text (harness/shader/includes.py) as a driver takes it: with its version, its extensions, `defines` and
    `declares` before it and `after` behind it.

    Words of older versions get those of `language`. In OpenGL ES everything has high precision; `zero`: every variable
    starts at zero.
    """
    text = _VERSION.sub(lambda found: hidden(found[0]), source.text)
    extensions = [f"#line {number_at(source.text, found.start())}\n{found[0].strip()}"
                  for found in _EXTENSION.finditer(text)]
    text = _EXTENSION.sub(lambda found: hidden(found[0]), text)
    macros = dict(defines or {})
    if zero:
        text = zero_initialised(text, {**language.macros, **macros})
    head = [language.line, *extensions]
    if language.es:
        head.append(_HIGH if language.number == 100 else _HIGH_300)
        head += [f"#define {low} highp" for low in sorted(set(_LOW.findall(text)))]
    head += [f"#define {name} {value}" for name, value in {**(_renamed(text, language)), **macros}.items()]
    if not language.old and re.search(r"\bgl_FragColor\b", text) and "gl_FragColor" not in macros:
        head += [f"layout(location = 0) out vec4 {OUTPUT};", f"#define gl_FragColor {OUTPUT}"]
    return replace(source, text="\n".join([*head, *declares, text]) + after)


def with_own_precision(text: str) -> str | None:
    """What `complete` made of a text, in the precision that its author asks for; None where that is high anyway."""
    lines = text.split("\n")
    if not any(line in _LOWERED for line in lines):
        return None
    return "\n".join("" if line in (_HIGH, _HIGH_300, *_LOWERED) else line for line in lines)


def _renamed(text: str, language: Language) -> dict[str, str]:
    if language.old:
        return {}
    found = set(_OLD_WORD.findall(text))
    return {old: new for old, new in _RENAMED.items() if old in found}
