"""Shaders that are wrong, careless or malicious, and the sentence that each is answered with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

RANDOM = """uint state_;
float rnd() { state_ = state_ * 747796405u + 2891336453u;
  uint w = ((state_ >> ((state_ >> 28u) + 4u)) ^ state_) * 277803737u;
  return float(((w >> 22u) ^ w) >> 8u) / 16777216.0; }
uint hash_(uint x) { x ^= x >> 16u; x *= 0x7feb352du; x ^= x >> 15u; x *= 0x846ca68bu; return x ^ (x >> 16u); }
void seed_(uvec2 p, uint n) { state_ = hash_(p.x + hash_(p.y + hash_(n))); }
"""
SAMPLE = "vec3(0.1) + vec3(0.8, 0.4, 0.2) * rnd()"
MEAN = "c = vec4(mix(o.rgb, s, 1.0 / (n + 1.0)), 1.0);"
SEED = "seed_(uvec2(p), uint(iFrame));"


@dataclass(frozen=True)
class Hostile:
    """Files by name; the first is the one that is checked. `answer`: a regular expression that a sentence must hold.
    `lost`: its process is lost, or has to be. `unlimited`: what it is, where that is another thing, on a driver that
    makes all iterations of a loop."""

    name: str
    files: Mapping[str, bytes]
    answer: str
    lost: bool = False
    unlimited: Hostile | None = None


def toy(name: str, answer: str, update: str = MEAN, sample: str = SAMPLE, seed: str = SEED, *,
        before: str = "") -> Hostile:
    """A Shadertoy buffer: `o` is its past, `s` the sample, `n` the frame's number, `c` what it leaves."""
    text = (f"{RANDOM}{before}\nvoid mainImage(out vec4 c, in vec2 p) {{\n{seed}\nvec3 s = {sample};\n"
            f"vec4 o = texelFetch(iChannel0, ivec2(p), 0);\nfloat n = float(iFrame);\n{update}\n}}\n")
    return Hostile(name, {"shader.glsl": text.encode()}, answer)


def body(name: str, answer: str, main: str, *, lost: bool = False, before: str = "") -> Hostile:
    """A Gratin body that has `rnd()`, `p` and its past `o`."""
    text = (f"{RANDOM}{before}\nin vec2 texcoord;\nvoid main() {{\nivec2 p = ivec2(gl_FragCoord.xy);\n"
            f"seed_(uvec2(p), uint(numpass));\nvec4 o = numpass > 0 ? texelFetch(pingpong0, p, 0) : vec4(0.0);\n"
            f"{main}\n}}\n")
    return Hostile(name, {"shader.frag": text.encode()}, answer, lost)


def raw(name: str, answer: str, text: str | bytes, file: str = "shader.frag", **others: str) -> Hostile:
    """Files as they are."""
    content = text.encode() if isinstance(text, str) else text
    return Hostile(name, {file: content, **{key.replace("__", "."): value.encode() for key, value in others.items()}},
                   answer)


def limited(unlimited: Hostile) -> Hostile:
    """A loop that a driver cuts short if it limits iterations."""
    return replace(unlimited, answer="the driver leaves it after 65535 iterations", lost=False, unlimited=unlimited)


SUM = "outBuffer0 = o + vec4(vec3(rnd()), 1.0);"
ENTITIES = ('<!DOCTYPE g [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]><Gratin type="pipeline">&b;'
            "</Gratin>")

READING = (
    raw("empty", "the file is empty", ""),
    raw("no main", r"no void main\(\)", "float f(float x) { return x; }\n"),
    raw("null bytes", r"shader\.frag", b"void main() { \0\0\0\xff\xfe }"),
    raw("not text", r"shader\.frag", bytes(range(256)) * 8),
    raw("include that climbs out", "leads out of the folder",
        '#include "../../etc/passwd"\nvoid main() { outBuffer0 = vec4(1.0) + texture(pingpong0, vec2(0)); }'),
    raw("absolute include", "leads out of the folder",
        '#include "/etc/passwd"\nvoid main() { outBuffer0 = vec4(1.0) + texture(pingpong0, vec2(0)); }'),
    raw("include of nothing", "no such file",
        '#include "nothing.glsl"\nvoid main() { outBuffer0 = vec4(1.0) + texture(pingpong0, vec2(0)); }'),
    raw("include of itself", "includes itself", '#include "shader.frag"\nvoid main() { outBuffer0 = vec4(numpass); }'),
    raw("comment without end", "comment", "void main() { outBuffer0 = vec4(numpass); /* and so on\n"),
    raw("no such version", "no version of GLSL", "#version 999\nout vec4 c; void main() { c = vec4(1.0); }"),
    raw("not a pipeline", "well-formed", '<Gratin type="pipeline"><broken', file="shader.gra"),
    raw("entities", "no shader that is known|Gratin never writes", ENTITIES, file="shader.gra"),
    raw("unknown uniform", r"nobody knows what 'float wavelength' is for.*--set wavelength=",
        "#version 330 core\nuniform sampler2D prev; uniform float wavelength; out vec4 c;\n"
        "void main() { c = texture(prev, vec2(0.5)) + vec4(wavelength); }"),
)
COMPILING = (
    body("syntax error", r"shader\.frag:\d+: syntax error", "outBuffer0 = vec4(1.0"),
    body("undeclared name", r"shader\.frag:\d+: `colour' undeclared", "outBuffer0 = vec4(colour, 1.0);"),
    body("wrong type", r"shader\.frag:\d+: ", "vec3 s = 1.0; outBuffer0 = o + vec4(s, 1.0);"),
    body("writes to a uniform", r"shader\.frag:\d+: ", "numpass = 3; outBuffer0 = o + vec4(1.0);"),
    body("recursion", "static recursion", SUM.replace("rnd()", "f(rnd())"),
         before="float f(float x) { return x < 0.0 ? 0.0 : f(x - 1.0); }"),
    body("brackets without number", r"shader\.frag", f"outBuffer0 = vec4({'(' * 20000}1.0{')' * 20000});"),
    body("array of a hundred million", r"shader\.frag:\d+: ",
         "const float big[100000000] = float[100000000](0.0); outBuffer0 = o + vec4(big[p.x]);"),
    body("sum of fifty thousand", "crashes the driver|takes|memory",
         f"outBuffer0 = o + vec4({'+'.join(['1.0'] * 50000)});", lost=True),
    raw("storage buffer", "only its own program knows what is in it",
        "#version 430 core\nuniform sampler2D prev; layout(std430, binding = 0) buffer Scene { vec4 spheres[]; };\n"
        "out vec4 c; void main() { c = texture(prev, vec2(0.5)) + spheres[int(gl_FragCoord.x)]; }"),
)
RUNNING = (
    body("frame without end", "takes longer than .* loop without end",
         f"float x = 0.0; while (x < 9.0) {{ {'x = sin(x + o.r + gl_FragCoord.x);' * 200} }} outBuffer0 = o + vec4(x);",
         lost=True),
    body("array of two million", "takes longer than|memory",
         "float big[2000000]; for (int i = 0; i < 2000000; ++i) big[i] = float(i); "
         "outBuffer0 = o + vec4(big[p.x * 20 + numpass]);", lost=True),
    limited(body("endless loop", "takes longer than .* loop without end",
                 f"float x = 0.0; while (true) {{ x += 1.0; if (x < -1.0) break; }} {SUM} outBuffer0.r += x * 1e-9;",
                 lost=True)),
    limited(body("loop of a hundred thousand", "",  # a right shader, where it is run
                 f"float x = 0.0; for (int i = 0; i < 100000; ++i) x += float(i & p.x); {SUM} "
                 "outBuffer0.r += x * 1e-12;")),
    toy("NaN flood", "100% of all samples are not finite", sample="sqrt(-vec3(0.5 + rnd()))"),
    toy("rare NaN", "samples are not finite.*one such sample spoils its pixel",
        sample="rnd() > 0.99 ? sqrt(vec3(-rnd())) : vec3(rnd())"),
    toy("ignores its seed", "every frame is the same, noise and all", seed="seed_(uvec2(p), 0u);"),
    toy("seed of the frame alone", "the noise of another|share random numbers", seed="seed_(uvec2(0), uint(iFrame));"),
    toy("seed of the diagonal", "share random numbers", seed="seed_(uvec2(p.x + p.y), uint(iFrame));"),
    toy("seed that starts anew", "frames 16 apart are the same", seed="seed_(uvec2(p), uint(iFrame) % 16u);"),
    toy("seeds that overlap", "frames 7 apart correlates",
        sample="vec3(rnd() + fract(sin(float(iFrame + 7) * 12.9898 + dot(p, vec2(78.233, 3.7))) * 43758.5453) "
               "+ fract(sin(float(iFrame) * 12.9898 + dot(p, vec2(78.233, 3.7))) * 43758.5453))"),
    toy("seed of the clock", "random numbers come from the clock alone", seed="seed_(uvec2(p), uint(iTime * 1000.0));"),
    toy("depends on the clock", "the picture itself changes with the clock", f"s *= 1.5 + sin(iTime); {MEAN}"),
    toy("depends on the resolution", "a size is written into the shader", f"s *= p.x / 16.0; {MEAN}"),
    body("never writes", "never writes its output", "vec4 c = o + vec4(vec3(rnd()), 1.0);"),
    body("discards all", "never writes its output|every pixel of every frame is 0", f"if (o.a < 1e9) discard; {SUM}"),
    body("black", "every pixel of every frame is 0", "outBuffer0 = o * 0.5;"),
    body("reads what nobody cleared", "the first frame reads its past, which in Gratin holds whatever was drawn before",
         "o = texelFetch(pingpong0, p, 0); outBuffer0 = o + vec4(vec3(rnd()), 1.0);"),
    body("begins from one", "the past that it begins from is not empty",
         "o = numpass > 0 ? o : vec4(1.0, 1.0, 1.0, 0.0); outBuffer0 = o + vec4(vec3(rnd()), 1.0);"),
    toy("counts one frame too many", "divided by another number of frames",
        "c = vec4(mix(o.rgb, s, 1.0 / (n + 2.0)), 1.0);"),
    toy("weighs new frames less", "not what the past leaves",
        "c = vec4(o.rgb * n / (n + 1.0) + s / (n + 2.0), 1.0);"),
    toy("fades", "old frames fade, so it never converges", "c = vec4(mix(o.rgb, s, 0.5), 1.0);"),
    toy("depends on the first frame", "old frames fade", "c = vec4(iFrame == 0 ? s : mix(o.rgb, s, 0.1), 1.0);"),
    toy("throws frames away but counts them", "throws its first 3 frames away but counts them",
        f"if (iFrame < 4) o = vec4(0.0); {MEAN}"),
    toy("ignores its past", "what it draws does not depend on it", "c = vec4(s, o.a * 0.0 + 1.0);"),
    toy("past of the neighbour", r"comes back .* pixels to the right",
        f"o = texelFetch(iChannel0, ivec2(p) + ivec2(1, 0), 0); {MEAN}"),
    toy("past half a pixel off", "comes back",
        f"o = texture(iChannel0, (p + 0.5) / iResolution.xy); {MEAN}"),
    toy("clamped sum", "not a linear function of its past", "c = vec4(min(o.rgb + s, vec3(1.0)), 1.0);"),
    toy("tone-mapped past", "not a linear function of its past",
        "vec3 m = mix(o.rgb, s, 1.0 / (n + 1.0)); c = vec4(m / (1.0 + m), 1.0);"),
    toy("clamps samples", r"shader\.glsl:\d+: samples are clamped to 1",
        f"s = 2.0 * s;\ns = min(s, vec3(1.0));\n{MEAN}"),
    toy("encodes samples", r"shader\.glsl:\d+: each frame is encoded before it is averaged",
        f"s = pow(s, vec3(1.0 / 2.2));\n{MEAN}"),
    toy("negative samples", "samples are below zero", sample="vec3(rnd()) - 0.3"),
)
_MANY = """#define SAMPLES 4
{random}void mainImage(out vec4 c, in vec2 p) {{ seed_(uvec2(p), uint(iFrame)); vec3 s = vec3(0.0); float one = rnd();
  for (int i = 0; i < SAMPLES; ++i) s += vec3(0.1, 0.3, 0.2) * ({one} < 0.1 ? 30.0 : 0.5);
  s /= float(SAMPLES); {then}
  c = vec4(mix(texelFetch(iChannel0, ivec2(p), 0).rgb, s, 1.0 / float(iFrame + 1)), 1.0); }}
"""
MEDIUM = """precision mediump float;
uniform sampler2D past; uniform float frame; uniform vec2 resolution;
void main() {
  float large = 300.0 + fract(sin(dot(gl_FragCoord.xy, vec2(12.9898, 78.233)) + frame) * 43758.5453);
  float s = large * large / 90000.0;
  gl_FragColor = vec4(mix(texture2D(past, gl_FragCoord.xy / resolution).rgb, vec3(s), 1.0 / (frame + 1.0)), 1.0); }
"""
VARIED = (
    raw("tone curve on frames", r"shader\.glsl:1: its mean depends on the samples of a frame .* with 16",
        _MANY.format(random=RANDOM, one="rnd()", then="s = s / (1.0 + s);"), "shader.glsl"),
    raw("samples of one frame alike", r"shader\.glsl:1: 64 samples a frame have the noise of 1: they share",
        _MANY.format(random=RANDOM, one="one", then=""), "shader.glsl"),
    raw("samples that agree", "^1, 4, 16 and 64 samples a frame give one mean",
        _MANY.format(random=RANDOM, one="rnd()", then=""), "shader.glsl"),
    raw("numbers beyond 16 bits", "in 16 bits, as on phones, it is another picture", MEDIUM),
    toy("one number at every bounce", r"shader\.glsl:\d+: with PCG's random numbers in place of its own the picture is "
        "another", "s = vec3(0.9, 0.8, 0.7) * same_rnd() * same_rnd();\n" + MEAN,
        before="float same_rnd()\n{ return fract(sin(dot(gl_FragCoord.xy, vec2(12.9898, 78.233)) + float(iFrame)) "
               "* 43758.5453); }\n"),
    toy("state in a corner", r"pixel \(0, 0\), counted from the lower left, holds something of its own",
        f"{MEAN} if (p.x < 1.0 && p.y < 1.0) c = vec4(32.0, 24.0, 0.0, 1.0);"),
)
HOSTILE = (*READING, *COMPILING, *RUNNING, *VARIED)
