"""Which host's dialect a text is in, and which files of a folder are meant."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.errors import HarnessError
from harness.shader.hosts import read
from harness.shader.hosts.reading import Given
from harness.shader.hosts.recognition import DIALECTS
from tests.support.strangers import contract_of, written

MAIN = "void main() { %s = vec4(1.0); }\n"


@pytest.mark.parametrize(("name", "text", "host"), [
    ("a__gra", "<?xml version='1.0'?><!-- a --><Gratin/>", "gratin"),
    ("a__frag", "in vec2 texcoord;\n" + MAIN % "outBuffer0", "body"),
    ("a__frag", "#version 420\nout vec4 outBuffer0;\n" + MAIN % "outBuffer0", "desktop"),
    ("a__json", '{"renderpass": []}', "shadertoy"),
    ("a__glsl", "void mainImage(out vec4 c, vec2 p) { c = vec4(1.0); }", "shadertoy"),
    ("a__glsl", '#iChannel0 "self"\nvoid mainImage(out vec4 c, vec2 p) { c = vec4(1.0); }', "vscode"),
    ("a__frag", "uniform float iTime;\n" + MAIN % "gl_FragColor", "webgl"),
    ("a__frag", "#version 300 es\nout highp vec4 c;\n" + MAIN % "c", "webgl"),
    ("a__frag", "#version 330\nout vec4 c;\n" + MAIN % "c", "desktop"),
    ("a__frag", "// pingpong0, gl_FragColor\nout vec4 c;\n" + MAIN % "c", "desktop"),
    ("a__frag", "uniform sampler2D u_doubleBuffer0;\n" + MAIN % "gl_FragColor", "glslviewer"),
])
def test_a_dialect_is_told_by_its_syntax(tmp_path: Path, name: str, text: str, host: str) -> None:
    try:
        found = contract_of(tmp_path, **{name: text}).host
    except HarnessError:
        given = [Given(path, path.read_text()) for path in tmp_path.iterdir()]
        found = next(dialect.name for dialect in DIALECTS if dialect.holds(given))
    assert found == host


def test_a_host_may_be_said(tmp_path: Path) -> None:
    text = "out vec4 c;\nuniform sampler2D previous;\n" + MAIN % "c"
    assert contract_of(tmp_path, host="desktop", a__frag=text).host == "desktop"
    with pytest.raises(HarnessError, match="no host 'vulkan'; there are gratin, native, glslviewer, body"):
        read([tmp_path / "a.frag"], "vulkan")


def test_of_a_folder_the_pipeline_or_the_shaders_are_meant(tmp_path: Path) -> None:
    lib = "float f() { return 1.0; }\n"
    text = '#version 330\n#include "lib.glsl"\nout vec4 c;\nvoid main() { c = vec4(f()); }'
    written(tmp_path, a__frag=text, lib__glsl=lib, readme__txt="no shader", package__json="{}", page__html="<html>")
    assert read([tmp_path]).passes[0].source.files[0][0] == str(tmp_path / "a.frag")
    written(tmp_path, toy__json='{"renderpass": [{"type": "image", "name": "Image", "code": "void mainImage(out vec4 '
                                'c, vec2 p) { c = vec4(1.0); }"}]}')
    assert read([tmp_path]).host == "shadertoy"


@pytest.mark.parametrize(("texts", "says"), [
    ({"readme__txt": "a"}, "no shader in this folder"),
    ({"a__gra": "<Gratin/>", "b__gra": "<Gratin/>"}, "2 files *.gra (a.gra, b.gra …); name one"),
    ({f"f{number}__glsl": "void main() {}" for number in range(65)}, "65 files that may be shaders"),
])
def test_a_folder_that_does_not_tell_is_refused(tmp_path: Path, texts: dict[str, str], says: str) -> None:
    written(tmp_path, **texts)
    with pytest.raises(HarnessError) as refusal:
        read([tmp_path])
    assert says in str(refusal.value)


def test_no_file_is_refused() -> None:
    with pytest.raises(HarnessError, match="no shader is named"):
        read([])


def test_how_a_file_was_read_is_noted(tmp_path: Path) -> None:
    path = tmp_path / "a.frag"
    path.write_bytes("// é\nvoid main() { gl_FragColor = vec4(1.0); }".encode("latin-1"))
    assert read([path]).notes[0].endswith("it is read as Latin-1")
