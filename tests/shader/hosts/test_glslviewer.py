"""Files for glslViewer."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.strangers import contract_of, drawn, refused

TEXT = """#ifdef GL_ES
precision mediump float;
#endif
uniform sampler2D u_doubleBuffer0;
uniform vec2 u_resolution;
uniform int u_frame;
#ifdef DOUBLE_BUFFER_0
void main() {
    vec2 uv = gl_FragCoord.xy / u_resolution;
    vec4 unset;
    gl_FragColor = texture2D(u_doubleBuffer0, uv) + vec4(uv, float(u_frame), 1);
}
#else
void main() {
    vec4 sum = texture2D(u_doubleBuffer0, gl_FragCoord.xy / u_resolution);
    gl_FragColor = vec4(sum.rgb / sum.a, 1.0);
}
#endif
"""


@pytest.mark.parametrize("head", ["", "#version 300 es\nprecision highp float;\n", "#version 330\n"])
def test_a_double_buffer_reads_itself_and_is_shown(tmp_path: Path, head: str) -> None:
    text = head + (TEXT.replace("1);\n}\n#else", "1.0);\n}\n#else") if head else TEXT)
    if "330" in head:
        text = text.replace("gl_FragColor", "color").replace("uniform int", "out vec4 color; uniform int")
    contract = contract_of(tmp_path, a__frag=text)
    assert contract.host == "glslviewer" and contract.radiance == "DOUBLE_BUFFER_0" and not contract.unknown
    assert [(one.name, one.displays) for one in contract.passes] == [("DOUBLE_BUFFER_0", False), ("image", True)]
    assert [c.reads for one in contract.passes for c in one.channels] == ["self", "pass:DOUBLE_BUFFER_0"]
    assert dict(contract.passes[0].roles) == {"u_resolution": "resolution", "u_frame": "frame"}
    assert drawn(contract)[0, 0].tolist() == pytest.approx([0.0625, 1 / 12, 0.0, 2.0])
    assert ("vec4 unset = vec4(0.0);" in contract.passes[0].source.text) == ("es" in head)  # WebGL's promise


def test_buffers_are_drawn_in_order(tmp_path: Path) -> None:
    text = ("uniform sampler2D u_buffer0, u_buffer1;\n#if defined(BUFFER_0)\nvoid main() { gl_FragColor = vec4(1); }\n"
            "#elif defined(BUFFER_1)\nvoid main() { gl_FragColor = texture2D(u_buffer0, vec2(0)); }\n#else\n"
            "void main() { gl_FragColor = texture2D(u_buffer1, vec2(0)); }\n#endif\n")
    contract = contract_of(tmp_path, a__frag=text)
    assert [(one.name, one.displays) for one in contract.passes] == [
        ("BUFFER_0", False), ("BUFFER_1", False), ("image", True)]
    assert {c.name: c.reads for c in contract.passes[2].channels} == {
        "u_buffer0": "pass:BUFFER_0", "u_buffer1": "pass:BUFFER_1"}


def test_a_pass_with_two_mains_or_none_is_named(tmp_path: Path) -> None:
    refused(tmp_path, "a second main()", a__frag=TEXT + "#ifdef DOUBLE_BUFFER_0\nvoid main() {}\n#endif")
    refused(tmp_path, "no void main()", a__frag=TEXT.replace("void main", "void min"))
