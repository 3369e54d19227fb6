"""Contracts made by hand: a bare Gratin body and a Shadertoy `mainImage` with feedback, without any reader of files."""

from __future__ import annotations

from harness.shader.contract import Channel, Contract, Declared, ShaderPass
from harness.shader.source import LINE_STRIDE, ShaderSource

VERTEX = """#version 420 core
out vec2 texcoord;
void main()
{
    texcoord = vec2((gl_VertexID << 1) & 2, gl_VertexID & 2);
    gl_Position = vec4(texcoord * 2.0 - 1.0, 0.0, 1.0);
}
"""
GRATIN_HEAD = """#version 420
layout(location = 0) out vec4 outBuffer0;
uniform sampler2D pingpong0;
uniform int numpass;
"""
TOY_HEAD = """#version 420
uniform vec3 iResolution; uniform float iTime; uniform int iFrame; uniform vec4 iMouse; uniform sampler2D iChannel0;
layout(location = 0) out vec4 toy_out_;
void mainImage(out vec4 color, in vec2 coord);
void main() { vec4 c = vec4(0.0, 0.0, 0.0, 1.0); mainImage(c, gl_FragCoord.xy); toy_out_ = c; }
"""
# PCG by pixel and number, in an expression `rnd()`.
RANDOM = """
uint state_;
float rnd() { state_ = state_ * 747796405u + 2891336453u;
  uint w = ((state_ >> ((state_ >> 28u) + 4u)) ^ state_) * 277803737u;
  return float(((w >> 22u) ^ w) >> 8u) / 16777216.0; }
uint hash_(uint x) { x ^= x >> 16u; x *= 0x7feb352du; x ^= x >> 15u; x *= 0x846ca68bu; return x ^ (x >> 16u); }
void seed_(uvec2 p, uint n) { state_ = hash_(p.x + hash_(p.y + hash_(n))); }
"""


def source(head: str, body: str, name: str) -> ShaderSource:
    return ShaderSource(f"{head}#line {LINE_STRIDE + 1} 0\n{body}\n", ((name, body),))


def gratin(body: str, name: str = "body.frag", host: str = "gratin") -> Contract:
    """A Gratin ping-pong node's body: `pingpong0`, `numpass`, `outBuffer0`, `texcoord`."""
    one = ShaderPass("pingpong", source(GRATIN_HEAD, f"in vec2 texcoord;{RANDOM}\n{body}", name), VERTEX,
                     (Channel("pingpong0", "self", linear=True),),
                     (Declared("numpass", "int", f"{name}:1"),), (("numpass", "frame"),))
    return Contract(host, (one,), "pingpong")


def shadertoy(body: str, name: str = "BufferA.glsl") -> Contract:
    """A Shadertoy buffer that reads itself on iChannel0."""
    one = ShaderPass("Buffer A", source(TOY_HEAD, f"{RANDOM}\n{body}", name), VERTEX,
                     (Channel("iChannel0", "self", linear=True),), (),
                     (("iResolution", "resolution"), ("iTime", "time"), ("iFrame", "frame"), ("iMouse", "mouse")))
    return Contract("shadertoy", (one,), "Buffer A")


# A sample in (0.1, 0.9) of three channels that differ, by pixel and frame.
SAMPLE = "vec3(0.1) + vec3(0.8, 0.4, 0.2) * rnd()"
SUM = ("void main() { uvec2 p = uvec2(gl_FragCoord.xy); seed_(p, uint(numpass)); vec4 old = numpass > 0 ? "
       f"texelFetch(pingpong0, ivec2(p), 0) : vec4(0.0); outBuffer0 = old + vec4({SAMPLE}, 1.0); }}")
MEAN = ("void mainImage(out vec4 c, in vec2 p) { seed_(uvec2(p), uint(iFrame)); "
        f"vec3 old = texelFetch(iChannel0, ivec2(p), 0).rgb; vec3 s = {SAMPLE}; "
        "c = vec4(mix(old, s, 1.0 / float(iFrame + 1)), 1.0); }")
