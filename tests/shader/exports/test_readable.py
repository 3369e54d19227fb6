"""Shaders as people read them: only what is used, under the name of its file, with the comment that belongs to it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from harness.scene import load_scene
from harness.shader.exports import base
from harness.shader.exports.readable import item, split
from harness.shader.library import OURS

SCENES = Path(__file__).parents[3] / "mitsuba_scenes"
SMALL = """#version 420 core
#line 100001 0 // a.glsl
// What a.glsl is for.
#ifndef A
#define A

#define TWICE(x) (2.0 * (x))
#define UNUSED 1

// A number, and
// why.
const float PI = 3.0, TAU = TWICE(PI);
struct Hit {
    float t;  // distance
};
float unused(float x)
{
    return x;
}

// Area of a disk.
float area(float r)
{
    if (r < 0.0) {
        r = -r;
    }
    return PI * r * r;
}
float area(vec2 r);
layout(location = 0) out vec4 color;

void main()
{
    Hit hit;
    color = vec4(area(TAU));
}
#endif
"""


def test_only_what_is_used_stays() -> None:
    names = [sorted(one.names) for one in split(SMALL).only(["main"]).items]
    assert names == [["TWICE"], ["PI", "TAU"], ["Hit"], ["area"], ["area"], ["color"], ["main"]]


def test_comments_stay_with_what_they_are_about() -> None:
    text = split(SMALL).only(["area"]).written()
    assert "// What a.glsl is for." in text
    assert "// A number, and\n// why.\nconst float PI" in text
    assert "// Area of a disk.\nfloat area(float r)\n{" in text
    assert "unused" not in text


def test_functions_can_stand_before_their_calls() -> None:
    """Which a translator to WGSL needs; nothing else changes its place."""
    text = "\n".join([
        "#line 100001 0 // a.glsl", "int late(int x);", "int a;", "int early(int x)", "{", "    return late(a);", "}",
        "int late(int x)", "{", "    return x;", "}", "void main()", "{", "    early(1);", "}"])
    found = split(text).without_prototypes()
    assert [sorted(one.names) for one in found.items] == [["a"], ["late"], ["early"], ["main"]]
    assert split(SMALL.replace("float area(vec2 r);", "")).without_prototypes().items == split(
        SMALL.replace("float area(vec2 r);", "")).items


@pytest.mark.parametrize(("code", "names"), [
    ("uniform sampler2D a;", {"a"}), ("float a, b[2], c = f(1.0, 2.0);", {"a", "b", "c"}),
    ("const vec3 A[2] = vec3[2](vec3(0.0), vec3(1.0));", {"A"}), ("precise float f(float x) { return x; }", {"f"}),
    ("precision highp float;", {"main"}), ("layout(location = 0) out vec4 color;", {"color"}),
])
def test_what_a_declaration_names(code: str, names: set[str]) -> None:
    assert item("a.glsl", code).names == names


@pytest.mark.parametrize("name", ["spheres", "displaced", "motion_blur", "textures"])
def test_no_clutter_is_left(name: str) -> None:
    """No branch that the scene has not chosen, no unused function, no directive but macros with a value."""
    whole = split(OURS.tracer(load_scene(SCENES / f"{name}.xml"), "mixture").text)
    text = whole.only(["main"]).written()
    assert {line.split()[0] for line in text.splitlines() if line.startswith("#")} == {"#define"}
    for function in re.findall(r"^\w+ (\w+)\([^;{}]*\)\n\{", text, re.MULTILINE):
        assert function == "main" or len(re.findall(rf"\b{function}\b", text)) > 1
    assert len(whole.only(["main"]).items) < len(whole.items)


def test_the_lines_that_es_changes_are_the_librarys() -> None:
    """What exports to GLSL ES replace must be there to be replaced."""
    source = OURS.tracer(load_scene(SCENES / "spheres.xml"), "mixture").text
    assert base.PRECISE in source
    noise = dict(OURS.tracer(load_scene(SCENES / "procedural.xml"), "mixture").files)["lib/noise.glsl"]
    for name, value in (("NOISE_X", base.NOISE_X), ("NOISE_Y", base.NOISE_Y), ("NOISE_OCTAVE", base.NOISE_OCTAVE)):
        assert f"const uint {name} = 0x{value:08x}u;" in noise
