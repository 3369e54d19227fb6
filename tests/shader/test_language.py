"""Versions, precision, and what goes before an author's text."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.errors import ShaderError
from harness.shader.includes import Piece, joined
from harness.shader.language import GLES_100, GLES_300, Language, complete, said_version
from tests.support.strangers import contract_of, drawn, refused


def said(text: str) -> tuple[Language | None, str]:
    return said_version(joined([Piece("a.frag", text)]))


@pytest.mark.parametrize(("line", "language", "note"), [
    ("#version 330 core", Language(330), ""), ("#version 300 es", GLES_300, ""), ("#version 100", GLES_100, ""),
    ("#version 460", Language(450), "a.frag:1: GLSL 4.60 is taken as 4.50"),
    ("#version 120", Language(330), "a.frag:1: GLSL 1.20 is taken as 3.30"), ("float a;", None, ""),
])
def test_the_version_is_one_that_the_driver_has(line: str, language: Language | None, note: str) -> None:
    assert said(f"{line}\n") == (language, note)


@pytest.mark.parametrize("line", ["#version 301 es", "#version 4", "#version", "#version 475", "#version 999"])
def test_a_version_that_does_not_exist_is_named(line: str) -> None:
    with pytest.raises(ShaderError, match=r"^a\.frag:2: '#version.*' is no version of GLSL"):
        said(f"// first\n{line}")


def test_extensions_and_the_version_go_first_and_lines_stay() -> None:
    text = "// one\n#version 300 es\n#extension GL_EXT_a : enable\nmediump float x;"
    source = complete(joined([Piece("a.frag", text)]), GLES_300, ["uniform int n;"], {"A": "1"})
    lines = source.text.splitlines()
    assert lines[:3] == ["#version 300 es", "#line 100003", "#extension GL_EXT_a : enable"]
    assert [line.strip() for line in lines[-5:]] == ["#line 100001 0", "", "", "", "mediump float x;"]
    assert lines.index("#define mediump highp") < lines.index("uniform int n;")
    assert lines.index("#define A 1") < lines.index("uniform int n;")


def test_int_has_32_bits_in_es(tmp_path: Path) -> None:
    """int is mediump by default in fragment shaders, and Mesa computes that in 16 bits."""
    text = "void main() { int n; for (int i = 0; i < 99999; i += 9000) n = i; gl_FragColor = vec4(float(n)); }"
    assert np.all(drawn(contract_of(tmp_path, a__frag=f"precision mediump float;\n{text}")) == 99000.0)


def test_words_of_old_versions_compile_in_new_ones(tmp_path: Path) -> None:
    contract = contract_of(tmp_path, a__frag="#version 120\nvarying vec2 uv;\nuniform sampler2D backbuffer;\n"
                           "void main() { gl_FragColor = texture2D(backbuffer, uv) + 1; }")
    assert drawn(contract).tolist()[0][0] == [1.0, 1.0, 1.0, 2.0]


def test_an_error_of_the_compiler_names_the_authors_line(tmp_path: Path) -> None:
    (tmp_path / "lib.glsl").write_text("/* two\nlines */\nfloat f() { return mistake; }\n")
    refused(tmp_path, f"{tmp_path}/lib.glsl:3: ", "mistake", "in the line `float f() { return mistake; }`",
            a__frag='#version 330\n\n#include "lib.glsl"\nout vec4 c;\nvoid main() { c = vec4(f()); }')
