"""Shadertoy: the tabs Common, Buffer A and Image, each as a file, and all three as one JSON of its API's form."""

from __future__ import annotations

import json

import numpy as np

from harness.errors import HarnessError
from harness.shader.exports.base import Job, fitted, shown
from harness.shader.exports.images import images_of, with_lookups, written

HOST = "shadertoy"
# Shadertoy's own id of Buffer A's output.
BUFFER_A = 257
# Texels that a scene's images may have in all: 192 compile at once on llvmpipe, but wgpu's translator takes minutes.
MOST_TEXELS = 256


def export(job: Job) -> dict[str, str]:
    """The tabs, and `NAME.json`. HarnessError for a scene with images that are too large to be written as constants:
    no channel of Shadertoy takes an image of one's own."""
    images = images_of(job.scene)
    texels = sum(int(np.prod(image.texels().shape[:2])) for image in images)
    if texels > MOST_TEXELS:
        names = ", ".join(image.file for image in images)
        raise HarnessError(f"scene '{job.scene.name}' reads images ({names}) of {texels} texels; Shadertoy takes no "
                           f"images of one's own, and at most {MOST_TEXELS} texels are written as constants: scale the "
                           "images down, or export to webgl, gratin, glslviewer or glsl")
    lookups, tracer = with_lookups(job.tracer(es=True).without_prototypes(), images, lambda _, image: written(image))
    head = job.head(
        "On shadertoy.com: this text is the tab Common; buffer_a.glsl that of Buffer A, whose iChannel0 is Buffer A",
        "itself; and image.glsl that of Image, whose iChannel0 is Buffer A too. The picture grows from frame to frame;",
        "the button that rewinds begins anew, and is to be pressed after a change of size.")
    common = "\n".join([head, *([lookups] if images else []), tracer.written(),
                        fitted(job.scene.width, job.scene.height), job.encode()])
    buffer_a = _buffer(job)
    image = _image(job)
    tabs = {"common.glsl": common, "buffer_a.glsl": buffer_a, "image.glsl": image}
    return {**tabs, f"{job.name}.json": _json(job, common, buffer_a, image)}


def _buffer(job: Job) -> str:
    return f"""// Buffer A, whose iChannel0 is Buffer A: rgb the sum of radiance, alpha the number of samples in it.
const int SAMPLES = {job.frame_samples};  // per pixel and frame

void mainImage(out vec4 color, in vec2 coord)
{{
    ivec4 film = film_in(ivec2(iResolution.xy));
    ivec2 pixel = ivec2(coord) - film.xy;
    color = vec4(0.0);
    if (any(lessThan(pixel, ivec2(0))) || any(greaterThanEqual(pixel, film.zw)))
        return;
    vec4 sum = iFrame > 0 ? texelFetch(iChannel0, ivec2(coord), 0) : vec4(0.0);
    color = trace_samples(sum, uvec2(pixel), vec2(film.zw), 0u, uint(iFrame) * uint(SAMPLES), SAMPLES);
}}
"""


def _image(job: Job) -> str:
    return f"""// Image, whose iChannel0 is Buffer A: the mean, encoded for the display.
void mainImage(out vec4 color, in vec2 coord)
{{
{shown(job.exposure, "texelFetch(iChannel0, ivec2(coord), 0)")}    color = vec4(encoded, 1.0);
}}
"""


def _json(job: Job, common: str, buffer_a: str, image: str) -> str:
    reads = [{"id": BUFFER_A, "src": "/media/previz/buffer00.png", "ctype": "buffer", "channel": 0, "published": 1,
              "sampler": {"filter": "nearest", "wrap": "clamp", "vflip": "true", "srgb": "false", "internal": "byte"}}]
    passes: list[dict[str, object]] = [
        {"type": "image", "name": "Image", "code": image, "inputs": reads, "outputs": [{"id": 37, "channel": 0}]},
        {"type": "buffer", "name": "Buffer A", "code": buffer_a, "inputs": reads,
         "outputs": [{"id": BUFFER_A, "channel": 0}]},
        {"type": "common", "name": "Common", "code": common, "inputs": [], "outputs": []},
    ]
    info = {"id": "", "date": "0", "viewed": 0, "name": job.scene.name, "username": "", "likes": 0, "published": 0,
            "flags": 32, "usePreview": 0, "tags": ["pathtracer"], "hasliked": 0,
            "description": f"Path tracer, strategy {job.strategy}."}
    whole = {"Shader": {"ver": "0.1", "info": info,
                        "renderpass": [{"description": "", **one} for one in passes]}}
    return json.dumps(whole, indent=1) + "\n"
