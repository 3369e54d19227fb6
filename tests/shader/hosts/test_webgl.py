"""Shaders for WebGL: files, pages and scripts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.shader.hosts import read
from tests.support.strangers import compiled, contract_of, drawn, refused

ES_100 = """precision mediump float;
uniform sampler2D u_previous;
uniform float u_weight, u_time;
uniform vec2 u_resolution;
varying vec2 v_uv;
void main() {
    vec3 color = vec3(v_uv, u_resolution.x);
    gl_FragColor = vec4(mix(color, texture2D(u_previous, v_uv).rgb, u_weight), 1.0);
}
"""
ES_300 = """#version 300 es
precision highp float;
uniform sampler2D accumTexture;
uniform int frameCount;
uniform uint seed;
in vec2 ndc;
out vec4 result;
void main() { result = texelFetch(accumTexture, ivec2(gl_FragCoord.xy), 0) + vec4(ndc, float(seed % 7u), 1.0); }
"""
VERTEX = ("attribute vec4 a_position;\nvarying vec2 v_uv;\n"
          "void main() { v_uv = a_position.xy; gl_Position = a_position; }")


def test_es_100(tmp_path: Path) -> None:
    contract = contract_of(tmp_path, a__frag=ES_100)
    assert contract.host == "webgl" and contract.radiance == "main" and not contract.unknown
    one = contract.passes[0]
    assert dict(one.roles) == {"u_weight": "past_weight", "u_time": "time", "u_resolution": "resolution"}
    assert [(channel.name, channel.reads) for channel in one.channels] == [("u_previous", "self")]
    assert drawn(contract)[0, 0].tolist() == pytest.approx([0.0625, 1 / 12, 8.0, 1.0])  # v_uv runs over 0 to 1


def test_es_300(tmp_path: Path) -> None:
    contract = contract_of(tmp_path, a__glsl=ES_300)
    assert dict(contract.passes[0].roles) == {"frameCount": "frame", "seed": "random"} and not contract.unknown
    assert drawn(contract)[0, 0].tolist() == pytest.approx([-0.875, -5 / 6, 0.0, 2.0])  # ndc runs over -1 to 1


def test_features_of_300_in_the_spelling_of_100(tmp_path: Path) -> None:
    text = "precision highp float;\nvoid main() { uint n = 7u >> 1; gl_FragColor = vec4(float(n)); }"
    assert drawn(contract_of(tmp_path, a__frag=text))[0, 0, 0] == 3.0


def test_a_function_of_the_authors_is_none_of_300(tmp_path: Path) -> None:
    text = ("precision highp float;\nmat2 transpose(mat2 m) { return m; }\n"
            "float round(\n    in float x) {\n    return x;\n}\n"
            "void main() { gl_FragColor = vec4(transpose(mat2(1.0))[0].x + round(0.25)); }")
    assert drawn(contract_of(tmp_path, a__frag=text))[0, 0, 0] == 1.25


def test_the_authors_vertex_shader_tells_what_a_varying_runs_over(tmp_path: Path) -> None:
    contract = contract_of(tmp_path, a__frag=ES_100, a__vert=VERTEX)
    assert drawn(contract)[0, 0, :2].tolist() == pytest.approx([-0.875, -5 / 6])
    moved = VERTEX.replace("varying", "uniform mat4 view;\nvarying").replace("= a_position;", "= view * a_position;")
    contract = contract_of(tmp_path, a__frag=ES_100, a__vert=moved)
    assert any("moves a scene's triangles" in note for note in contract.notes)


def test_a_varying_of_which_nobody_knows_is_noted_and_may_be_said(tmp_path: Path) -> None:
    text = ES_100.replace("v_uv", "v_where")
    note = contract_of(tmp_path, a__frag=text).notes[0]
    assert "a.frag:5: 'v_where' is taken to run over 0 to 1; else say --set v_where=ndc" in note
    said = contract_of(tmp_path, values={"v_where": "ndc"}, a__frag=text)
    assert not said.notes and drawn(said)[0, 0, 0] == -0.875


PAGE = """<html>’<script type="x-shader/x-vertex">{vertex}</script>
<script id="trace" type="x-shader/x-fragment">
{trace}</script>
<script id="show" type="x-shader/x-fragment">
precision mediump float; uniform sampler2D tex; varying vec2 v_uv;
void main() {{ gl_FragColor = texture2D(tex, v_uv); }}</script><script>let a = 1;</script></html>"""


def test_a_page_keeps_its_lines(tmp_path: Path) -> None:
    page = PAGE.format(vertex=VERTEX, trace=ES_100)
    contract = contract_of(tmp_path, page__html=page)
    assert contract.passes[0].uniforms[1].where == f"{tmp_path}/page.html:7"
    assert any("page.html:16: another fragment shader, which is left out" in note for note in contract.notes)
    assert drawn(contract)[0, 0, 0] == -0.875
    refused(tmp_path, "page.html:12: `colour' undeclared", "in the line `gl_FragColor = vec4(mix(colour",
            page__html=page.replace("mix(color,", "mix(colour,"))


@pytest.mark.parametrize("script", [
    "const N = 3.0;\nexport default `{}`;", "const char *source = R\"glsl({})glsl\";",
])
def test_a_script_keeps_its_lines(tmp_path: Path, script: str) -> None:
    cpp = script.startswith("const char")
    text = script.replace("{}", ES_100 if cpp else ES_100.replace("v_uv, u_res", "v_uv, ${ N } + u_res"))
    contract = contract_of(tmp_path, **{"a__cpp" if cpp else "a__js": text})
    assert contract.passes[0].uniforms[0].where.endswith("a.cpp:2" if cpp else "a.js:3")
    assert drawn(contract)[0, 0, 2] == (8.0 if cpp else 11.0)


def test_a_quoted_string_is_a_shader_too(tmp_path: Path) -> None:
    script = "var f = '" + ES_100.replace("\n", "\\n") + "';"
    assert contract_of(tmp_path, a__js=script).passes[0].channels[0].reads == "self"


def test_a_slot_that_only_the_program_can_fill_is_named(tmp_path: Path) -> None:
    refused(tmp_path, "a.js:3: only its program knows '${scene}'", a__js="\nx = `void main() {\n${scene} }`")
    refused(tmp_path, "a.js:1: no shader in it", a__js="let a = 1;")


@pytest.mark.parametrize(("text", "size"), [
    ("gl_FragColor = vec4(gl_FragCoord.xy / 512.0, 0.0, 1.0);", (512, 512)),
    ("vec2 resolution = vec2(640.0, 480.0); gl_FragColor = vec4(resolution, 0.0, 1.0);", (640, 480)),
    ("const float WIDTH = 320.0, HEIGHT = 200.0; gl_FragColor = vec4(WIDTH, HEIGHT, 0.0, 1.0);", (320, 200)),
    ("const int WIDTH = 320; const int HEIGHT = 200; gl_FragColor = vec4(WIDTH / HEIGHT);", (320, 200)),
    ("gl_FragColor = vec4(gl_FragCoord.xy / 2.0, 0.0, 1.0);", None),
])
def test_a_size_that_is_written_in_is_found(tmp_path: Path, text: str, size: tuple[int, int] | None) -> None:
    contract = contract_of(tmp_path, a__frag=f"precision highp float;\nvoid main() {{ {text} }}")
    assert contract.size == size and bool(contract.notes) == bool(size)


def test_unknown_uniforms_are_asked_for_by_name(tmp_path: Path) -> None:
    text = ES_100.replace("varying", "uniform vec3 eye; uniform float idle; uniform sampler2D map; uniform mat3 m;\n"
                          "uniform float steps[2];\nvarying").replace("vec3(v_uv", "m * eye * steps[1] + "
                                                                      "texture2D(map, v_uv).rgb + vec3(v_uv")
    contract = contract_of(tmp_path, a__frag=text)
    assert [(one.name, one.kind, one.size) for one in contract.unknown] == [
        ("eye", "vec3", 0), ("map", "sampler2D", 0), ("m", "mat3", 0), ("steps", "float", 2)]
    assert {c.name: c.reads for c in contract.passes[0].channels} == {"u_previous": "self", "map": "black"}
    values = {"eye": (1.0, 2.0, 3.0), "map": "noise", "m": tuple(map(float, range(9))), "steps": (0.5, 1.0),
              "u_time": "random", "u_weight": 0.25}
    known = read([tmp_path / "a.frag"], values=values)
    compiled(known)
    assert not known.unknown and dict(known.values)["steps"] == (0.5, 1.0)
    assert ("u_time", "random") in known.passes[0].roles and dict(known.values)["u_weight"] == 0.25
    assert "u_weight" not in dict(known.passes[0].roles)


@pytest.mark.parametrize(("name", "value", "says"), [
    ("eyes", 1.0, "--set eyes: the shader declares no uniform of that name; it declares u_previous, u_resolution"),
    ("u_weight", (1.0, 2.0), "a.frag:3: --set u_weight: a float has 1 number, found 2"),
    ("u_resolution", 1.0, "a vec2 has 2 numbers, found 1"),
    ("u_time", "tiem", "neither a value nor what a uniform is for"),
    ("u_previous", "past", "a sampler reads self, keyboard"), ("v_uv", "sideways", "say unit (0 to 1) or ndc"),
    ("u_previous", "pass:other", "reads the pass 'other', which is not there; there are main"),
])
def test_answers_that_do_not_fit_are_named(tmp_path: Path, name: str, value: float | str, says: str) -> None:
    refused(tmp_path, says, values={name: value}, a__frag=ES_100)


def test_a_whole_number_is_asked_for_where_the_shader_has_one(tmp_path: Path) -> None:
    refused(tmp_path, "takes a whole number, found 1.5", values={"frameCount": 1.5}, a__glsl=ES_300)
    image = drawn(contract_of(tmp_path, values={"seed": 12}, a__glsl=ES_300))
    assert np.all(image[..., 2] == 5.0)
