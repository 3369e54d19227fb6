"""Which uniforms a shader declares, where, and whether with a value."""

from __future__ import annotations

import pytest

from harness.shader.source import ShaderSource
from harness.shader.uniforms import Uniform, uniforms


def declared(*texts: str) -> dict[str, Uniform]:
    return uniforms(ShaderSource("", tuple((f"{name}.frag", text) for name, text in zip("abc", texts, strict=False))))


@pytest.mark.parametrize(("text", "expected"), [
    ("uniform float sky;", {"sky": False}),
    ("uniform float sky = 1.0;", {"sky": True}),
    ("layout(binding = 1, r32f) uniform highp sampler2D noise;", {"noise": False}),
    ("uniform float a = max(1.0, 2.0), b[3], c = 0.5;", {"a": True, "b": False, "c": True}),
    ("uniform vec2 two[2] = vec2[2](vec2(0.0, 1.0), vec2(2.0, 3.0));", {"two": True}),
    ("uniform vec3 v\n  = { 1.0, 2.0, 3.0 };", {"v": True}),
    ("uniform Camera { vec3 from; float fov; } camera;", {"Camera": False}),
    ("layout(std430) buffer Data { float values[]; };", {"Data": False}),
    ("uniform struct Light { vec3 at; } light;", {"light": False}),
    ("// uniform float no;\n/* uniform int\nno; */ float uniformly(float buffered) { return buffered; }", {}),
])
def test_are_found_with_and_without_a_value(text: str, expected: dict[str, bool]) -> None:
    assert {name: uniform.initialised for name, uniform in declared(text).items()} == expected


def test_stand_in_a_file_and_a_line() -> None:
    found = declared("// one\n\nuniform int a;", "/* two\n */ uniform int b;\nuniform int a;")
    assert {name: uniform.where for name, uniform in found.items()} == {"a": "a.frag:3", "b": "b.frag:2"}


def test_of_two_declarations_one_with_a_value_counts() -> None:
    """Of two branches of the preprocessor nobody but the compiler knows which is taken."""
    assert declared("#ifdef A\nuniform int n;\n#else\nuniform int n = 3;\n#endif")["n"] == Uniform("a.frag:4", True)
