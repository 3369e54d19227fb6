"""Uniforms, constants and macros of somebody's shader: which there are, and the shader with other values there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from harness.errors import ShaderError
from harness.shader.contract import Contract
from harness.shader.hosts import read
from harness.shader.named import named, with_values

TEXT = """#version 330 core
#define SAMPLES 4
#define SCALE 2.5
#define TINT vec3(1.0, 0.5, 0.25)
#define TWICE(x) (2.0 * (x))
#ifdef FANCY
#endif
uniform sampler2D past;
uniform int frame;
uniform float alpha;
uniform float known = 3.0;
const float gain = max(1.0,
    2.0), off = 0.5;
const int rows = 3;
const bool lit = true;
const float steps[2] = float[2](1.0, 2.0);
in vec2 uv;
out vec4 color;
void main()
{
    const float inner = 1.0;
    float power = gain;
    color = vec4(TINT * alpha * known * gain * off * inner * SCALE * float(rows + SAMPLES) * steps[0], 1.0) / power;
    color += texture(past, uv) * float(frame) * (lit ? 1.0 : 0.0);
}
"""


@pytest.fixture
def contract(tmp_path: Path) -> Contract:
    (tmp_path / "a.frag").write_text(TEXT, encoding="utf-8")
    return read([tmp_path / "a.frag"])


def changed(contract: Contract, **values: str) -> tuple[Contract, list[str]]:
    """The contract with these values, and its lines that are not as they were."""
    found = with_values(contract, values)
    before, after = (each.passes[0].source.text.splitlines() for each in (contract, found))
    assert len(before) == len(after), "lines keep their numbers"
    return found, [new for old, new in zip(before, after, strict=True) if old != new]


def test_names_are_those_that_have_one_value(contract: Contract) -> None:
    assert named(contract) == ("alpha", "known", "gain", "off", "rows", "lit", "SAMPLES", "SCALE", "TINT", "frame")


def test_a_uniform_is_given_its_value_and_asked_for_no_more(contract: Contract) -> None:
    assert [one.name for one in contract.unknown] == ["alpha"]
    found, lines = changed(contract, alpha="10", known="1e-7", frame="2")
    assert (dict(found.values), found.unknown, lines) == ({"alpha": 10.0, "known": 1e-7, "frame": 2}, (), [])
    assert found.passes[0].roles == () and found.said == ("alpha=10", "known=1e-7", "frame=2")


@pytest.mark.parametrize(("name", "value", "line"), [
    ("gain", "10", "const float gain = 10.0"), ("off", "-1", "    2.0), off = (-1.0);"),
    ("rows", "5", "const int rows = 5;"), ("lit", "false", "const bool lit = false;"),
    ("SAMPLES", "8", "#define SAMPLES 8"), ("SAMPLES", "0.5", "#define SAMPLES 0.5"),
    ("SCALE", "3", "#define SCALE 3.0"),
    ("TINT", "0 1 0", "#define TINT vec3(0.0, 1.0, 0.0)"), ("TINT", "0,1,0", "#define TINT vec3(0.0, 1.0, 0.0)"),
])
def test_a_constant_and_a_macro_are_written_anew(contract: Contract, name: str, value: str, line: str) -> None:
    found, lines = changed(contract, **{name: value})
    assert lines[0] == line
    assert found.said == (f"{name}={value}",) and found != contract
    if name == "gain":
        assert lines[1] == ", off = 0.5;"


def test_samples_of_a_frame_are_what_the_text_says_now(contract: Contract) -> None:
    assert (contract.samples, changed(contract, SAMPLES="16")[0].samples) == (4, 16)
    assert with_values(replace(contract, samples=7), {"SAMPLES": "16"}).samples == 7, "somebody else said it"


def test_what_it_has_not_is_left(contract: Contract) -> None:
    assert with_values(contract, {"inner": "3", "TWICE": "1", "FANCY": "1", "past": "1", "steps": "1"}) == contract


@pytest.mark.parametrize(("name", "value", "message"), [
    ("alpha", "bright", r"a\.frag:10: --set alpha: a float is numbers, found 'bright'; give it numbers with spaces"),
    ("alpha", "1 2", r"a\.frag:10: --set alpha: a float has 1 number, found 2"),
    ("rows", "2.5", r"a\.frag:14: --set rows: 'int rows' takes a whole number, found 2\.5"),
    ("TINT", "2", r"a\.frag:4: --set TINT: a vec3 has 3 numbers, found 1"),
])
def test_a_value_that_does_not_fit_is_refused_with_its_line(contract: Contract, name: str, value: str,
                                                           message: str) -> None:
    with pytest.raises(ShaderError, match=message) as caught:
        with_values(contract, {name: value})
    assert "\n" not in str(caught.value)
