"""Fragment shaders for OpenGL on the desktop."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.strangers import contract_of, drawn, refused

TEXT = """#version 460 core
layout(location = 0) in vec2 texCoords;
layout(location = 0) out vec4 color;
uniform sampler2D historyTexture;
uniform int u_frameIndex;
uniform float sampleCount = 1.0;
const int SPP = 4;
void main() {
    color = texture(historyTexture, texCoords) + vec4(texCoords, u_frameIndex + sampleCount, SPP);
}
"""


def test_it_is_read_by_the_names_of_its_uniforms(tmp_path: Path) -> None:
    contract = contract_of(tmp_path, a__fs=TEXT)
    assert contract.host == "desktop" and contract.samples == 4 and not contract.unknown
    assert contract.passes[0].roles == (("u_frameIndex", "frame"),)  # a value of its own counts
    assert any("GLSL 4.60 is taken as 4.50" in note for note in contract.notes)
    assert drawn(contract)[0, 0].tolist() == pytest.approx([0.0625, 1 / 12, 1.0, 5.0])


def test_members_of_structures_have_names(tmp_path: Path) -> None:
    text = TEXT.replace("const int", "uniform struct { vec3 at; float fov; } camera;\nconst int").replace(
        "SPP)", "camera.fov + camera.at.x)")
    assert [one.name for one in contract_of(tmp_path, a__fs=text).unknown] == ["camera.at", "camera.fov"]
    known = contract_of(tmp_path, values={"camera.fov": 2.0, "camera.at": (3.0, 0.0, 0.0)}, a__fs=text)
    assert not known.unknown and drawn(known)[0, 0, 3] == 6.0


@pytest.mark.parametrize(("text", "says"), [
    ("layout(std430, binding = 1) buffer Scene { vec4 s[]; };", "a.fs:7: storage buffers"),
    ("uniform Scene { vec4 s[4]; };", "a.fs:7: a block, 'Scene'"),
    ("flat in int id;", "a.fs:7: 'id' (int) comes from a"),
])
def test_what_only_its_program_can_fill_is_named(tmp_path: Path, text: str, says: str) -> None:
    refused(tmp_path, says, a__fs=TEXT.replace("const", f"{text}\nconst").replace("SPP)", "id)") if "id;" in text
            else TEXT.replace("const", f"{text}\nconst"))


def test_files_without_an_entry_are_named(tmp_path: Path) -> None:
    refused(tmp_path, "a.fs:1: no shader that is known (no void main(), no void mainImage())", a__fs="float f();")
    refused(tmp_path, "no fragment shader with void main()", a__fs="void main() { gl_Position = vec4(0.0); }")
    refused(tmp_path, "no host 'metal'; there are gratin, native", host="metal", a__fs=TEXT)
