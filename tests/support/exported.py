"""A small host for exported shaders: what each dialect's own program would draw, frame by frame."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any
from xml.etree import ElementTree

import moderngl
import numpy as np

from harness.gpu.context import context
from harness.gpu.pingpong import PingPong
from harness.gpu.samplers import Samplers
from harness.samples.tone import encode_srgb
from harness.scene import Scene
from harness.shader.exports.images import Image, images_of
from harness.shader.hosts.native import NATIVE
from harness.shader.library import OURS
from harness.shader.source import ShaderSource

_VERTEX = """#version {version}
out vec2 texcoord;
void main()
{{
    texcoord = vec2((gl_VertexID << 1) & 2, gl_VertexID & 2);
    gl_Position = vec4(texcoord * 2.0 - 1.0, 0.0, 1.0);
}}
"""
SHADERTOY_HEAD = """#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
uniform vec3 iResolution;
uniform int iFrame;
uniform sampler2D iChannel0;
out vec4 shadertoy_out;
"""
SHADERTOY_TAIL = "\nvoid main() { mainImage(shadertoy_out, gl_FragCoord.xy); }\n"

Files = Mapping[str, str | bytes]
Uniforms = Callable[[int], Mapping[str, Any]]


def accumulate(fragment: str, size: tuple[int, int], frames: int, previous: str, uniforms: Uniforms,
               scene: Scene | None = None, images: Sequence[tuple[str, Image]] = (),
               start: np.ndarray | None = None) -> np.ndarray:
    """What `frames` frames leave, (H, W, 4) float32, row 0 at the top; `previous` samples the last one. The images of
    `scene` are bound as the harness does; `images`, by their sampler, as a host does that knows nothing of them: as the
    file is, last row first, without a filter. `start`, (H, W, 4): what the first frame finds, anything if not given."""
    gl = context()
    version = re.match(r"#version (.*)", fragment)
    assert version, "a shader begins with its version"
    desktop = "420 core" if "es" not in version[1] else version[1]
    program = gl.program(vertex_shader=_VERTEX.format(version=desktop), fragment_shader=fragment)
    triangle = gl.vertex_array(program, [])
    stale = np.random.default_rng(1).uniform(1, 9, (size[1], size[0], 4)) if start is None else start[::-1]
    stale = stale.astype(np.float32).tobytes()
    textures = [gl.texture(size, 4, stale, dtype="f4") for _ in range(2)]
    framebuffers = [gl.framebuffer([texture]) for texture in textures]
    samplers = Samplers(scene, ShaderSource(fragment, ())) if scene else None
    loaded = {sampler: _loaded(gl, image) for sampler, image in images}
    for number in range(frames):
        textures[number % 2].filter = moderngl.NEAREST, moderngl.NEAREST
        textures[number % 2].use(0)
        framebuffers[1 - number % 2].use()
        gl.scissor = None
        bound = dict(samplers.bind(1)) if samplers else {}
        for unit, (sampler, texture) in enumerate(loaded.items(), start=1):
            texture.use(unit)
            bound[sampler] = unit
        for name, value in {previous: 0, **bound, **uniforms(number)}.items():
            if name in program:
                program[name].value = value
        triangle.render(moderngl.TRIANGLES, vertices=3)
    pixels = np.frombuffer(textures[frames % 2].read(), np.float32).reshape(size[1], size[0], 4)[::-1].copy()
    for thing in (triangle, program, *framebuffers, *textures, *loaded.values(), *([samplers] if samplers else [])):
        thing.release()
    return pixels


def _loaded(gl: moderngl.Context, image: Image) -> moderngl.Texture:
    texels = image.texels()[::-1]
    texels = encode_srgb(texels) if image.encoded else texels
    height, width = texels.shape[:2]
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = texels
    texture = gl.texture((width, height), 4, rgba.tobytes(), dtype="f4")
    texture.filter = moderngl.NEAREST, moderngl.NEAREST
    return texture


@functools.lru_cache(maxsize=16)
def rendered(scene: Scene, strategy: str, samples: int) -> np.ndarray:
    """What `harness render` sums over as many samples of replica 0, (H, W, 4) float32, row 0 at the top."""
    source = OURS.tracer(scene, strategy)
    samplers = Samplers(scene, source)
    pingpong = PingPong(source, (scene.width, scene.height), NATIVE, samplers.bind, 64)
    try:
        return pingpong.total(0, 0, samples, None).astype(np.float32)
    finally:
        pingpong.release()
        samplers.release()


def displayed(host: str, files: Files, sums: np.ndarray) -> np.ndarray:
    """What the picture of an export shows of `sums`, (H, W, 4) with row 0 at the top: (H, W, 3) float32."""
    texts = {name: text for name, text in files.items() if isinstance(text, str)}
    whole = next(iter(texts.values()))
    size = sums.shape[1], sums.shape[0]
    told: Mapping[str, Any] = {}
    if host == "shadertoy":
        text, sampler = SHADERTOY_HEAD + texts["common.glsl"] + texts["image.glsl"] + SHADERTOY_TAIL, "iChannel0"
    elif host == "glslviewer":
        text, sampler = whole, "u_doubleBuffer0"
    elif host == "webgl":
        found = re.search(r'<script id="display"[^>]*>(.*?)</script>', whole, re.DOTALL)
        exposure = re.search(r'id="exposure" [^>]*value="([^"]+)"', whole)
        assert found and exposure
        text, sampler, told = found[1], "u_previous", {"u_exposure": float(exposure[1])}
    elif host == "gratin":
        graph = ElementTree.fromstring(whole)
        head = ("#version 420\nlayout(location = 0) out vec4 outBuffer0;\nuniform sampler2D inBuffer0;\n"
                "uniform float exposure;\n")
        text, sampler = head + value(named(graph, "node-1"), "genericFragBody"), "inBuffer0"
        told = {"exposure": float(value(named(graph, "nodeWidget-1", "childWidget-0"), "currentVal"))}
    else:
        text, sampler = next(text for name, text in texts.items() if name.endswith(".display.frag")), "pingpong0"
    return accumulate(text, size, 1, sampler, lambda _: told, start=sums)[..., :3]


def _gratin(pipeline: str, frames: int, scene: Scene) -> np.ndarray:
    """What Gratin's ping-pong node would draw: with the head that Gratin writes, and the widgets' values."""
    graph = ElementTree.fromstring(pipeline)
    node = named(graph, "node-0")
    names = [value(node, f"genericWidgetName-{index}") for index in range(int(value(node, "genericNbWidgets")))]
    widgets = [float(value(named(graph, "nodeWidget-0", f"childWidget-{index}"), "currentVal"))
               for index in range(len(names))]
    inputs = [value(graph, f"nodeInputName-0-{index}") for index in range(int(value(graph, "nodeInputNameSize-0")))]
    head = "\n".join(["#version 420", "layout(location = 0) out vec4 outBuffer0;",
                      *(f"uniform sampler2D {name};" for name in inputs), *(f"uniform float {name};" for name in names),
                      "uniform sampler2D pingpong0;", "uniform int numpass;", ""])
    width, height = (int(value(named(node, "genericTOffset"), axis)) for axis in "01")
    return accumulate(head + value(node, "genericFragBody"), (width, height), frames, "pingpong0",
                      lambda n: {"numpass": n, **dict(zip(names, widgets, strict=True))},
                      images=list(zip(inputs, images_of(scene), strict=True)))


def named(data: ElementTree.Element, *names: str) -> ElementTree.Element:
    """The element of that name anywhere below, of the next below that, and so on."""
    for name in names:
        found = data.find(f".//*[@name='{name}']")
        assert found is not None, f"the pipeline has no {name}"
        data = found
    return data


def value(data: ElementTree.Element, name: str) -> str:
    """What the element of that name holds."""
    return named(data, name).attrib["val"]


def drawn(host: str, files: Files, scene: Scene, frames: int, window: tuple[int, int] | None = None) -> np.ndarray:
    """What a host's own program sums of its exported `files`, in a window of the film's size if none is given."""
    size = window or (scene.width, scene.height)
    texts = {name: text for name, text in files.items() if isinstance(text, str)}
    if host == "shadertoy":
        text = SHADERTOY_HEAD + texts["common.glsl"] + texts["buffer_a.glsl"] + SHADERTOY_TAIL
        return accumulate(text, size, frames, "iChannel0", lambda n: {"iFrame": n, "iResolution": (*size, 1.0)})
    if host == "glslviewer":
        version, _, rest = next(iter(texts.values())).partition("\n")
        return accumulate(f"{version}\n#define DOUBLE_BUFFER_0\n{rest}", size, frames, "u_doubleBuffer0",
                          lambda n: {"u_frame": n, "u_resolution": size},
                          images=[(image.sampler, image) for image in images_of(scene)])
    if host == "gratin":
        return _gratin(next(iter(texts.values())), frames, scene)
    if host == "webgl":
        page = next(iter(texts.values()))
        text = re.search(r'<script id="tracer"[^>]*>(.*?)</script>', page, re.DOTALL)
        assert text
        return accumulate(text[1], size, frames, "u_previous", lambda n: {"u_frame": n, "u_resolution": size}, scene)
    if host == "glsl":
        tracer = next(text for name, text in texts.items() if not name.endswith(".display.frag"))
        return accumulate(tracer, size, frames, "pingpong0", lambda n: {"numpass": n}, scene)
    raise NotImplementedError(host)
