"""Every variable starts at zero, and nothing else changes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.shader.zero_init import zero_initialised
from tests.support.strangers import contract_of, drawn


@pytest.mark.parametrize(("text", "expected"), [
    ("float a; vec3 b = vec3(1.0), c;", "float a = 0.0; vec3 b = vec3(1.0), c = vec3(0.0);"),
    ("highp mat3 m;\nivec2 i; uint u; bvec4 t;",
     "highp mat3 m = mat3(0.0);\nivec2 i = ivec2(0); uint u = 0u; bvec4 t = bvec4(false);"),
    ("void f() { for (int i; i < 3;) { float x; } }", "void f() { for (int i = 0; i < 3;) { float x = 0.0; } }"),
    ("#define R float\nR a;", "#define R float\nR a = 0.0;"),
    ("struct S { vec2 p; int n; }; S s;", "struct S { vec2 p; int n; }; S s = S(vec2(0.0), 0);"),
    ("struct S { float x; } s;", "struct S { float x; } s = S(0.0);"),
    ("void f(in float a, out vec3 b, out float c) { b.x = 1.0; }",
     "void f(in float a, out vec3 b, out float c) { b = vec3(0.0); c = 0.0; b.x = 1.0; }"),
    ("void f() { float a[3], b; }", "void f() { float a[3], b = 0.0; "
     "for (int zero_0_ = 0; zero_0_ < int(3); ++zero_0_) { a[zero_0_] = 0.0; } }"),
    ("void f() { switch (1) { case 0: float x; } }", "void f() { switch (1) { case 0: float x = 0.0; } }"),
    ("float g[2];\nvoid main() { }", "float g[2];\nvoid main() { "
     "for (int zero_0_ = 0; zero_0_ < int(2); ++zero_0_) { g[zero_0_] = 0.0; } }"),
    ("out vec4 color;\nvoid main() { }", "out vec4 color;\nvoid main() { color = vec4(0.0); }"),
    ("void main() { gl_FragColor.a = 1.0; }", "void main() { gl_FragColor = vec4(0.0); gl_FragColor.a = 1.0; }"),
    ("#ifdef A\nfloat a;\n#else\nfloat b;\n#endif", "#ifdef A\nfloat a;\n#else\nfloat b = 0.0;\n#endif"),
])
def test_gets_zeros(text: str, expected: str) -> None:
    assert zero_initialised(text) == expected


@pytest.mark.parametrize("text", [
    "uniform float a; in vec2 b; const float c = 1.0; varying vec2 d; layout(location = 0) in vec2 e;",
    "precision highp float;", "float f(float x);", "float f(in float x, inout float y) { return x + y; }",
    "const struct T { uint a, b; } t = T(1u, 2u);", "uniform struct { float x; } u;",
    "vec3 f() { return vec3(1.0); }", "void f() { x = a ? vec3(1.0) : vec3(2.0); }", "struct S { sampler2D t; }; ",
    "float a = 1.0, b[2] = float[2](1.0, 2.0);", "void f() { if (a) return; else b = 1.0; }",
    "void f() { for (float a[2]; ; ) { } }", "}}}) ; float (", "void f( {", "struct", "struct { float x; ",
])
def test_leaves_alone(text: str) -> None:
    assert zero_initialised(text) == text


def test_a_structure_with_arrays_is_zeroed_member_by_member() -> None:
    text = "struct S { float x[2]; vec2 p; };\nvoid f() { S s[3]; }"
    assert zero_initialised(text).endswith(
        "S s[3]; for (int zero_0_ = 0; zero_0_ < int(3); ++zero_0_) { for (int zero_1_ = 0; zero_1_ < int(2); "
        "++zero_1_) { s[zero_0_].x[zero_1_] = 0.0; } s[zero_0_].p = vec2(0.0); } }")


_BODY = """struct Hit { float t; vec3 n; float w[2]; };
float total;
vec3 table[2];
void find(out Hit hit, out float more) { hit.n.x = 0.25; }
void main() {
    float sum, parts[3];
    Hit hit;
    find(hit, total);
    for (int i = 0; i < 3; i++) sum += parts[i];
    gl_FragColor.rg = vec2(sum + hit.t + hit.w[1] + total + table[1].y, hit.n.x + hit.n.y);
}
"""


@pytest.mark.parametrize("head", ["", "#version 300 es\n"])
def test_what_an_author_left_out_is_zero_on_a_desktop_driver_too(tmp_path: Path, head: str) -> None:
    image = drawn(contract_of(tmp_path, a__frag=f"{head}precision mediump float;\n{_BODY}"))
    np.testing.assert_array_equal(image, np.broadcast_to([0.0, 0.25, 0.0, 0.0], image.shape))
