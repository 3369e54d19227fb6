"""Shadertoys: exports and tabs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from harness.shader.hosts import read
from tests.support.strangers import compiled, contract_of, drawn, refused, written

COMMON = "float seed;\nfloat draw() { seed += 1.0; return fract(seed * 0.37); }\n"
BUFFER = ("void mainImage(out vec4 color, in vec2 at) {\n    seed = float(iFrame);\n"
          "    color.rgb += vec3(draw(), at / iResolution.xy);\n    color += texelFetch(iChannel0, ivec2(at), 0);\n}\n")
IMAGE = ("void mainImage(out vec4 color, in vec2 at) {\n    color = texelFetch(iChannel0, ivec2(at), 0);\n"
         "    color /= float(iFrame + 1);\n}\n")


def buffer_input(ident: object, channel: int = 0, **more: Any) -> dict[str, Any]:
    return {"channel": channel, "id": ident, "sampler": {"filter": "linear", "wrap": "clamp"}, **more}


def export(kind: str, *extra: dict[str, Any], buffer: str = BUFFER, image: str = IMAGE) -> dict[str, Any]:
    """`kind`: the key that names what an input is, 'ctype' in the API, 'type' on the page."""
    return {"ver": "0.1", "renderpass": [
        {"type": "image", "name": "Image", "code": image, "inputs": [buffer_input(257, **{kind: "buffer"})],
         "outputs": [{"id": 37, "channel": 0}]},
        {"type": "buffer", "name": "Buf A", "code": buffer, "inputs": [buffer_input(257, **{kind: "buffer"}), *extra],
         "outputs": [{"id": 257, "channel": 0}]},
        {"type": "common", "name": "Common", "code": COMMON, "inputs": [], "outputs": []},
        {"type": "sound", "name": "Sound", "code": "", "inputs": [], "outputs": []}]}


@pytest.mark.parametrize("kind", ["ctype", "type"])
@pytest.mark.parametrize("wrap", [lambda data: {"Shader": data}, lambda data: data, lambda data: [data]])
def test_an_export_holds_wiring_and_text(tmp_path: Path, kind: str, wrap: Any) -> None:
    contract = contract_of(tmp_path, toy__json=json.dumps(wrap(export(kind))))
    assert contract.host == "shadertoy" and contract.radiance == "Buffer A" and not contract.unknown
    assert [(one.name, one.displays) for one in contract.passes] == [("Buffer A", False), ("Image", True)]
    assert [(c.reads, c.linear) for one in contract.passes for c in one.channels] == [
        ("self", True), ("pass:Buffer A", True)]
    assert dict(contract.passes[0].roles) == {"iResolution": "resolution", "iFrame": "frame"}
    assert any("sound pass is left out" in note for note in contract.notes)
    assert drawn(contract, iFrame=2)[0, 0].tolist() == pytest.approx([0.11, 0.0625, 1 / 12, 1.0])


def test_inputs_that_are_not_here_have_stand_ins(tmp_path: Path) -> None:
    text = BUFFER.replace("draw()", "texture(iChannel1, vec3(0.5)).r + texture(iChannel2, at).r + texture(iChannel3, "
                                    "at).r + iChannelResolution[1].x + iChannelTime[0]")
    extra = [buffer_input(1, 1, ctype="cubemap"), buffer_input(2, 2, ctype="keyboard"),
             buffer_input(3, 3, ctype="texture")]
    contract = contract_of(tmp_path, toy__json=json.dumps(export("ctype", *extra, buffer=text)))
    assert [(c.reads, c.kind) for c in contract.passes[0].channels] == [
        ("self", "sampler2D"), ("cube", "samplerCube"), ("keyboard", "sampler2D"), ("noise", "sampler2D")]
    assert sum("reads a stand-in" in note for note in contract.notes) == 3


def test_a_channel_without_an_input_is_black_and_never_the_past(tmp_path: Path) -> None:
    text = BUFFER.replace("draw()", "texture(iChannel3, at).r")
    contract = contract_of(tmp_path, toy__json=json.dumps(export("ctype", buffer=text)))
    assert {c.name: c.reads for c in contract.passes[0].channels} == {"iChannel0": "self", "iChannel3": "black"}


def test_an_idle_channel_may_read_a_buffer_that_is_gone_but_no_other(tmp_path: Path) -> None:
    gone = buffer_input(258, 1, ctype="buffer")
    contract_of(tmp_path, toy__json=json.dumps(export("ctype", gone)))
    refused(tmp_path, "toy.json (Buffer A): iChannel1 reads a buffer that no pass writes (id 258)",
            toy__json=json.dumps(export("ctype", gone, buffer=BUFFER.replace("draw()", "texture(iChannel1, at).r"))))


@pytest.mark.parametrize("names", [("common__glsl", "bufferA__glsl", "image__glsl"),
                                   ("COMMON__frag", "Buffer_a__frag", "Image__frag"),
                                   ("toy_common__glsl", "toy-buf-a__glsl", "toy_image__glsl"),
                                   ("common__fs", "buf0__fs", "main__fs")])
def test_files_are_tabs_by_their_names(tmp_path: Path, names: tuple[str, str, str]) -> None:
    texts = dict(zip(names, ("\ufeff" + COMMON, BUFFER, IMAGE), strict=True))
    contract = contract_of(tmp_path, **texts)
    assert [one.name for one in contract.passes] == ["Buffer A", "Image"] and contract.passes[1].displays
    assert [c.reads for one in contract.passes for c in one.channels] == ["self", "pass:Buffer A"]
    assert sum("iChannel0 is taken to read" in note for note in contract.notes) == 2  # no file says it
    written(tmp_path, Sound__glsl="vec2 mainSound(float t) { return vec2(0.0); }",
            index__html="<script type='x-shader/x-fragment'>void main() { gl_FragColor = vec4(1.0); }\n</script>")
    assert read([tmp_path]).passes == contract.passes  # a folder, with the page that shows them


def test_wiring_may_be_said(tmp_path: Path) -> None:
    paths = written(tmp_path, bufferA__glsl=BUFFER.replace("draw()", "texture(iChannel1, vec3(1.0)).r"),
                    common__glsl=COMMON, image__glsl=IMAGE)
    contract = read(paths, values={"Buffer A.iChannel1": "cube", "Image.iChannel0": "pass:Buffer A"})
    compiled(contract)
    assert contract.passes[0].channels[1].kind == "samplerCube"
    assert not any("Image" in note or "iChannel1" in note for note in contract.notes if "is taken" in note)


def test_a_single_tab_reads_its_own_past(tmp_path: Path) -> None:
    contract = contract_of(tmp_path, mine__glsl=COMMON + BUFFER)
    assert [(one.name, one.displays) for one in contract.passes] == [("Image", False)]
    assert contract.passes[0].channels[0].reads == "self"


def test_a_channel_that_is_looked_up_by_directions_is_a_cube_map(tmp_path: Path) -> None:
    text = COMMON + BUFFER.replace("color.rgb +=", "vec3 up = vec3(0.0, 1.0, 0.0);\n    color += texture(iChannel1, "
                                                   "up);\n    color.rgb +=")
    contract = contract_of(tmp_path, image__glsl=IMAGE, bufferA__glsl=text)
    assert [(c.reads, c.kind) for c in contract.passes[0].channels] == [("self", "sampler2D"), ("cube", "samplerCube")]


def test_samples_of_a_frame_are_those_of_the_pass_that_sums(tmp_path: Path) -> None:
    contract = contract_of(tmp_path, image__glsl="#define SAMPLES 64\n" + IMAGE,
                           bufferA__glsl=f"#define SPP 4\n{COMMON}{BUFFER}")
    assert contract.samples == 4


@pytest.mark.parametrize(("text", "says"), [
    ("{\n\n", "toy.json:3: not JSON"), ('{"a": 1}', "no export of one Shadertoy"),
    ("[" * 9999, "JSON nested too deeply"),
    ('{"renderpass": []}', "an export without an image or a buffer"),
    ('[{"renderpass": []}, {}]', "no export of one Shadertoy"),
    (json.dumps(export("type", image=IMAGE.replace("mainImage", "paint"))), "no void main()"),
    (json.dumps(export("type", buffer=BUFFER.replace("at /", "at * wrong /"))), "(Buffer A):3: `wrong' undeclared"),
])
def test_exports_that_are_none_are_named(tmp_path: Path, text: str, says: str) -> None:
    refused(tmp_path, "toy.json", says, toy__json=text)


def test_files_that_are_no_tabs_are_named(tmp_path: Path) -> None:
    refused(tmp_path, "other.glsl: its name says no tab", bufferA__glsl=BUFFER, other__glsl=IMAGE)
    refused(tmp_path, "common.glsl:1: no void main()", common__glsl=COMMON, host="shadertoy")
    (tmp_path / "other.glsl").unlink()
    refused(tmp_path, "Buffer A, and so does", bufferA__glsl=BUFFER, bufA__glsl=BUFFER)
