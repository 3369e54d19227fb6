"""Uniforms that nobody sets make an image arbitrary: they are named, with what the harness does set."""

from __future__ import annotations

import pytest

from harness.errors import ShaderError
from harness.gpu.pingpong import PingPong
from harness.shader.hosts.native import NATIVE
from harness.shader.source import ShaderSource

SHADER = """#version 420 core
uniform sampler2D pingpong0;
uniform int numpass;
DECLARED
layout(location = 0) out vec4 sum;
void main()
{
    vec4 before = numpass > 0 ? texelFetch(pingpong0, ivec2(gl_FragCoord.xy), 0) : vec4(0.0);
    sum = before + vec4(vec3(VALUE), 1.0);
}
"""


def compiled(declared: str, value: str) -> None:
    text = SHADER.replace("DECLARED", declared).replace("VALUE", value)
    source = ShaderSource(text, (("own.frag", text),))
    PingPong(source, (4, 4), NATIVE, lambda first: {"bitmap0": first}, 1).release()


@pytest.mark.parametrize(("declared", "value", "told"), [
    ("uniform float sky;", "sky", "'sky', so"),
    ("uniform sampler2D blue_noise;", "texelFetch(blue_noise, ivec2(0), 0).r", "'blue_noise', so"),
    ("uniform vec3 lights[4];", "lights[numpass & 3]", "'lights', so"),
    ("uniform struct Light { float power; vec3 at; } lamp;", "lamp.power * lamp.at", "'lamp', so"),
    ("uniform Sun { vec3 power; };", "power", "'Sun', so"),
    ("uniform vec2 iResolution, iMouse;", "iResolution.x + iMouse.x", "'iMouse' (iResolution neither), so"),
])
def test_that_the_image_depends_on_are_refused_with_their_line(declared: str, value: str, told: str) -> None:
    with pytest.raises(ShaderError) as caught:
        compiled(declared, value)
    message = str(caught.value)
    assert message.startswith(f"own.frag:4: nothing sets the uniform {told} the image is arbitrary; ")
    assert message.endswith("; the harness sets pingpong0, numpass, samples_per_pass, replica, first_sample, bitmap0")


@pytest.mark.parametrize(("declared", "value"), [
    ("uniform float sky = 0.5;", "sky"),
    ("uniform float weights[2] = float[2](0.5, 0.25);", "weights[numpass & 1]"),
    ("uniform sampler2D blue_noise;", "1.0"),
    ("uniform sampler2D bitmap0;", "texelFetch(bitmap0, ivec2(0), 0).r"),
    ("uniform uint replica; uniform uint first_sample; uniform int samples_per_pass;",
     "float(replica + first_sample) + float(samples_per_pass)"),
])
def test_that_have_a_value_or_no_use_are_fine(declared: str, value: str) -> None:
    compiled(declared, value)
