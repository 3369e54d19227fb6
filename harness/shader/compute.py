"""The tracer as a compute shader: glsl/path_tracer.comp in place of glsl/path_tracer.frag, around the same library."""

from __future__ import annotations

import re
from dataclasses import replace

from harness.files import data_dir
from harness.shader.library import MAIN
from harness.shader.source import LINE_STRIDE, ShaderSource

COMPUTE = "path_tracer.comp"
# Pixels that a group of glsl/path_tracer.comp fills, across and up.
GROUP = 8
# What stands before the first file of an assembled text: its version, and macros.
_HEAD = re.compile(r"#version[^\n]*\n")
_EXTENSION = re.compile(r"^#extension [^\n]*\n", re.MULTILINE)
_MAIN = re.compile(r"^#line \d+ 0 //", re.MULTILINE)
_INCLUDE = re.compile(r"^#include [^\n]*\n", re.MULTILINE)


def as_compute(source: ShaderSource) -> ShaderSource | None:
    """An assembled tracer with the other `main`; None for one whose file with `main` is not ours, and so has its own.

    Library files are those of the source, whosever they are.
    """
    glsl = data_dir("glsl")
    if source.files[0][1] != (glsl / MAIN).read_text(encoding="utf-8"):
        return None
    ours = (glsl / COMPUTE).read_text(encoding="utf-8")
    version, extension = _HEAD.match(source.text), _EXTENSION.search(ours)
    assert version and extension
    # Behind its last include each `main` stands alone, under the number that the file has in the text.
    library = source.text[version.end():list(_MAIN.finditer(source.text))[-1].start()]
    includes = list(_INCLUDE.finditer(ours))[-1].end()
    line = LINE_STRIDE + ours.count("\n", 0, includes) + 1
    return replace(source, text=f"{version[0]}{extension[0]}{library}#line {line} 0 // {COMPUTE}\n{ours[includes:]}",
                   files=((COMPUTE, ours), *source.files[1:]))
