"""WebGL 2: one page that opens from a file, sums in float textures and shows how many samples there are."""

from __future__ import annotations

import base64
import html
import json
from importlib import resources
from string import Template

import numpy as np

from harness.shader.exports.base import Job
from harness.shader.exports.images import Image, images_of

HOST = "webgl"


class _Page(Template):
    """page.html, whose holes begin with @: JavaScript has uses of its own for $."""

    delimiter = "@"


def export(job: Job) -> dict[str, str]:
    """`NAME.html`; a scene's images are in it."""
    page = _Page(resources.files("harness.shader.exports").joinpath("page.html").read_text(encoding="utf-8"))
    head = job.head("Open this file in a browser with WebGL 2 and float render targets (EXT_color_buffer_float).",
                    mark="")
    tracer = _tracer(job)
    return {f"{job.name}.html": page.substitute(
        head=head.replace("--", "- -").rstrip(), title=html.escape(f"{job.scene.name}, {job.strategy}"),
        width=job.scene.width, height=job.scene.height, exposure=f"{job.exposure:g}", samples=job.frame_samples,
        tracer=_harmless(tracer), display=_harmless(_display(job)),
        images=_harmless(json.dumps([_embedded(image) for image in images_of(job.scene, tracer)]), r"<\u002f",
                         r"<\u0021"))}


def _harmless(text: str, slash: str = "< /", mark: str = "< !") -> str:
    """Text that cannot end the script element that it stands in, whatever a scene calls its shapes and files."""
    return text.replace("</", slash).replace("<!", mark)


def _tracer(job: Job) -> str:
    return f"""precision highp float;
precision highp int;
precision highp sampler2D;

{job.tracer(es=True).written()}
// ==== the pass {"=" * 100}

uniform sampler2D u_previous;  // rgb the sum of radiance, alpha the number of samples in it
uniform vec2 u_resolution;
uniform int u_frame;

layout(location = 0) out vec4 color;

const int SAMPLES = {job.frame_samples};  // per pixel and frame

void main()
{{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 sum = u_frame > 0 ? texelFetch(u_previous, pixel, 0) : vec4(0.0);
    color = trace_samples(sum, uvec2(pixel), u_resolution, 0u, uint(u_frame) * uint(SAMPLES), SAMPLES);
}}"""


def _display(job: Job) -> str:
    return f"""precision highp float;
precision highp sampler2D;

{job.encode()}
uniform sampler2D u_previous;
uniform float u_exposure;  // stops

layout(location = 0) out vec4 color;

void main()
{{
    vec4 sum = texelFetch(u_previous, ivec2(gl_FragCoord.xy), 0);
    vec3 mean = sum.a > 0.0 ? sum.rgb / sum.a : vec3(0.0);
    color = vec4(encode_srgb(mean * exp2(u_exposure)), 1.0);
}}"""


def _embedded(image: Image) -> dict[str, object]:
    texels = image.texels()
    height, width, channels = texels.shape
    return {"sampler": image.sampler, "file": image.file, "width": width, "height": height, "channels": channels,
            "repeats": image.repeats, "nearest": image.nearest,
            "texels": base64.b64encode(np.ascontiguousarray(texels, "<f4").tobytes()).decode()}
