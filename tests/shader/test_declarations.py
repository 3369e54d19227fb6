"""What is declared outside of functions."""

from __future__ import annotations

import pytest

from harness.errors import ShaderError
from harness.shader.contract import Declared
from harness.shader.declarations import Declarations, declarations, entry
from harness.shader.includes import Piece, joined
from harness.shader.source import ShaderSource


def source_of(text: str) -> ShaderSource:
    return joined([Piece("a.frag", text)])


def found(text: str, **defines: str) -> Declarations:
    return declarations(source_of(text), defines)


@pytest.mark.parametrize(("text", "expected"), [
    ("uniform float a;", [("a", "float", 0, False)]),
    ("layout(binding = 1) uniform highp sampler2D a, b;", [("a", "sampler2D", 0, False), ("b", "sampler2D", 0, False)]),
    ("uniform float a = max(1.0, 2.0), b[3], c = 0.5;",
     [("a", "float", 0, True), ("b", "float", 3, False), ("c", "float", 0, True)]),
    ("#define N 4\nuniform vec3 a[N];", [("a", "vec3", 4, False)]),
    ("uniform float[2] a;", [("a", "float", 2, False)]),
    ("struct C { vec3 at; float f, g; }; uniform C c;",
     [("c.at", "vec3", 0, False), ("c.f", "float", 0, False), ("c.g", "float", 0, False)]),
    ("uniform struct { float f; } c;", [("c.f", "float", 0, False)]),
    ("struct S { vec3 at; }; uniform S s[2];", [("s", "S", 2, False)]),
    ("#if 0\nuniform int a;\n#endif", []), ("void main() { float uniform_; }", []),
])
def test_uniforms(text: str, expected: list[tuple[str, str, int, bool]]) -> None:
    assert [(one.name, one.kind, one.size, one.initialised) for one in found(text).uniforms] == expected


def test_uniforms_stand_in_a_file_and_a_line() -> None:
    assert found("\n\nuniform int a;").uniforms == [Declared("a", "int", "a.frag:3")]


def test_varyings_outputs_and_functions() -> None:
    one = found("layout(location = 2) in vec2 uv; flat in int n; out vec4 color; const float k = 1.0;\n"
                "vec3 f(in vec3 x);\nvec3 f(in vec3 x) { return x; }\nvoid main() { }")
    assert [(v.kind, v.name, v.layout, v.flat) for v in one.varyings] == [
        ("vec2", "uv", "layout(location = 2) ", False), ("int", "n", "", True)]
    assert one.outputs == [("vec4", "color")]
    assert one.functions == {"f": ["a.frag:3"], "main": ["a.frag:4"]}
    assert {"uv", "color", "k", "f", "main"} <= one.declared


@pytest.mark.parametrize(("text", "message"), [
    ("\nbuffer B { float x[]; };", "a.frag:2: storage buffers"), ("uniform B { float x; };", "a block, 'B'"),
    ("layout(local_size_x = 8) in;", "compute shaders"), ("uniform image2D i;", "an image2D, 'i'"),
])
def test_storage_of_another_program_is_refused(text: str, message: str) -> None:
    with pytest.raises(ShaderError) as refusal:
        found(text)
    assert message in str(refusal.value) and "only its own program knows" in str(refusal.value)


@pytest.mark.parametrize(("text", "name"), [
    ("void main() {}", "main"), ("void mainImage(out vec4 c, vec2 p) {}", "mainImage"),
    ("#define Main void mainImage(out vec4 c, vec2 p)\nMain { }", "mainImage"),
    ("#ifdef A\nvoid main() {}\n#else\nvoid main() {}\n#endif", "main"),
])
def test_the_entry(text: str, name: str) -> None:
    assert entry(source_of(text), found(text)) == name


@pytest.mark.parametrize(("text", "message"), [
    ("void f() {}", "a.frag:1: no void main()"),
    ("void main() {}\nvoid main() {}", "a.frag:2: a second main(), the first is at a.frag:1"),
])
def test_no_entry_or_two_are_refused(text: str, message: str) -> None:
    with pytest.raises(ShaderError) as refusal:
        entry(source_of(text), found(text))
    assert str(refusal.value).startswith(message)
