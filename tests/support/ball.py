"""A ball under a sky, as a Mitsuba scene and as somebody's shader: in an even sky it is as bright as its albedo."""

from __future__ import annotations

from tests.strangers.hostile import RANDOM

SIZE = (16, 16)
SCENE = """<!-- A diffuse ball, off the centre, in a sky of radiance 1. -->
<scene version="3.0.0">
    <integrator type="path"><integer name="max_depth" value="3"/></integrator>
    <sensor type="perspective">
        <float name="fov" value="22"/>
        <transform name="to_world"><lookat origin="0, 0, 6" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm">
            <integer name="width" value="16"/> <integer name="height" value="16"/> <rfilter type="box"/>
        </film>
    </sensor>
    <emitter type="constant"><rgb name="radiance" value="1, 1, 1"/></emitter>
    <shape type="sphere">
        <point name="center" x="0.15" y="0.1" z="0"/> <float name="radius" value="1"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.6, 0.5, 0.4"/></bsdf>
    </shape>
</scene>
"""
# The cosine of a direction that is drawn evenly over the hemisphere is even in [0, 1]; its weight is 2 cos.
RIGHT = "2.0 * rnd() * vec3(0.6, 0.5, 0.4)"
BRIGHT = "2.0 * 1.02 * rnd() * vec3(0.6, 0.5, 0.4)"
COSINE_TWICE = "2.0 * pow(rnd(), 2.0) * vec3(0.6, 0.5, 0.4)"
_TRACE = """vec3 trace(vec2 pixel, vec2 size, float side)
{
    vec2 p = (pixel + vec2(rnd(), rnd())) / size * 2.0 - 1.0;
    vec3 o = vec3(-0.15 * side, -0.1, 6.0), d = normalize(vec3(p * tan(radians(11.0)), -1.0));
    float b = dot(o, d), c = dot(o, o) - 1.0;
    return b * b > c ? LIGHT : vec3(1.0);
}
"""


def body(light: str = RIGHT, side: float = 1.0, factor: str = "1.0") -> str:
    """A Gratin body that sums `factor` times its samples; `side` -1 mirrors it."""
    return (f"{RANDOM}{_TRACE.replace('LIGHT', light)}in vec2 texcoord;\nvoid main()\n{{\n"
            "    uvec2 pixel = uvec2(texcoord * vec2(textureSize(pingpong0, 0)));\n"
            "    seed_(pixel, uint(numpass));\n"
            "    vec4 old = numpass > 0 ? texelFetch(pingpong0, ivec2(pixel), 0) : vec4(0.0);\n"
            f"    vec3 s = trace(vec2(pixel), vec2(textureSize(pingpong0, 0)), {side});\n"
            f"    outBuffer0 = old + vec4({factor} * s, 1.0);\n}}\n")


def toy(light: str = RIGHT, encoded: str = "s") -> str:
    """A Shadertoy buffer that averages; `encoded`: what each sample `s` is put through before."""
    return (f"{RANDOM}{_TRACE.replace('LIGHT', light)}void mainImage(out vec4 color, in vec2 coord)\n{{\n"
            "    seed_(uvec2(coord), uint(iFrame));\n"
            "    vec3 old = texelFetch(iChannel0, ivec2(coord), 0).rgb;\n"
            "    vec3 s = trace(floor(coord), iResolution.xy, 1.0);\n"
            f"    color = vec4(mix(old, {encoded}, 1.0 / float(iFrame + 1)), 1.0);\n}}\n")
