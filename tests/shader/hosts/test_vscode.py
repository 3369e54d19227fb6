"""Files for VS Code's shader-toy extension."""

from __future__ import annotations

from pathlib import Path

from tests.support.strangers import contract_of, drawn, refused

SUM = """#include "lib.glsl"
#iChannel0 "self" // its past
#iChannel0::MinFilter "Linear"
#iChannel1 "https://example.org/noise.png"
#iUniform float gain = 2.0 in { 0.0, 4.0 }
#iUniform color3 tint = color3(1.0, 0.5, 0.25)
void main() {
    vec2 uv = gl_FragCoord.xy / iResolution.xy;
    vec4 past = texture2D(iChannel0, uv);
    gl_FragColor = past + vec4(gain * tint * f(), 1.0) + 0.0 * texture(iChannel1, uv);
    if (iTime < 0.0 || iMouseButton.x > 0.0) gl_FragColor = vec4(0.0);
}
"""
LIB = "float f() { return 3.0; }\n"


def test_directives_wire_it(tmp_path: Path) -> None:
    (tmp_path / "lib.glsl").write_text(LIB)
    contract = contract_of(tmp_path, main__glsl=SUM)
    assert contract.host == "vscode" and not contract.unknown
    assert [(c.name, c.reads, c.linear) for c in contract.passes[0].channels] == [
        ("iChannel0", "self", True), ("iChannel1", "noise", False)]
    assert any("main.glsl:4: iChannel1 reads something of the web" in note for note in contract.notes)
    assert contract.values == (("gain", 2.0), ("tint", (1.0, 0.5, 0.25))) and not contract.said
    assert drawn(contract)[0, 0].tolist() == [6.0, 3.0, 1.5, 2.0]
    said = contract_of(tmp_path, values={"gain": 4.0}, main__glsl=SUM)
    assert drawn(said)[0, 0].tolist() == [12.0, 6.0, 3.0, 2.0]


def test_files_are_passes(tmp_path: Path) -> None:
    (tmp_path / "lib.glsl").write_text(LIB)
    (tmp_path / "buffer.glsl").write_text(SUM)
    show = ('#iChannel0 "file://buffer.glsl"\nvoid mainImage(out vec4 color, in vec2 at) {\n'
            "    color = texture(iChannel0, at / iResolution.xy);\n    color /= color.a;\n}\n")
    contract = contract_of(tmp_path, show__glsl=show)
    assert [(one.name, one.displays) for one in contract.passes] == [("buffer", False), ("Image", True)]
    assert contract.passes[1].channels[0].reads == "pass:buffer" and contract.radiance == "buffer"


def test_main_with_undeclared_names_of_shadertoy_is_one(tmp_path: Path) -> None:
    contract = contract_of(tmp_path, a__glsl="void main() { gl_FragColor = vec4(iFrame); }")
    assert contract.host == "vscode" and contract.passes[0].roles == (("iFrame", "frame"),)


def test_what_leads_out_and_what_is_no_uniform_are_named(tmp_path: Path) -> None:
    end = "\nvoid main() { gl_FragColor = vec4(0.0); }"
    refused(tmp_path, 'a.glsl:2: iChannel0 reads "file://../b.glsl", which leads out',
            a__glsl=f'\n#iChannel0 "file://../b.glsl"{end}')
    refused(tmp_path, "a.glsl:1: '#iUniform what'", a__glsl=f"#iUniform what{end}")
    refused(tmp_path, "a.glsl:1: `missing' undeclared", "in the line `#iUniform float x = missing",
            a__glsl=f"#iUniform float x = missing in {{0.0, 1.0}}{end.replace('vec4(0.0)', 'vec4(x)')}")
