"""glslViewer: one file, which is its double buffer and its picture."""

from __future__ import annotations

from harness.shader.exports.base import Job, fitted, shown
from harness.shader.exports.images import images_of, loaded, with_lookups
from harness.shader.scene.literals import in_comment

HOST = "glslviewer"
VERSION = "#version 420"  # it must be the file's first characters


def export(job: Job) -> dict[str, str]:
    """`NAME.frag`; a scene's images are named on glslViewer's command line."""
    width, height = job.scene.width, job.scene.height
    name = f"{job.name}.frag"
    images = images_of(job.scene)
    command = " ".join([f"glslViewer {name} -w {width} -h {height}",
                        *(f"-{image.sampler} {image.file}" for image in images)])
    how = [in_comment(command)]
    if any(image.file.lower().endswith(".exr") for image in images):
        how.append("glslViewer reads no .exr: save such an image as Radiance .hdr, and name that.")
    lookups, tracer = with_lookups(job.tracer(), images, lambda _, image: loaded(image, image.sampler))
    samplers = "".join(f"uniform sampler2D {image.sampler};  // {in_comment(image.file)}, as it is\n"
                       for image in images)
    parts = [f"{VERSION}\n{job.head(*how)}", *([samplers, lookups] if images else []), tracer.written(),
             fitted(width, height), job.encode(), _mains(job)]
    return {name: "\n".join(parts)}


def _mains(job: Job) -> str:
    return f"""uniform sampler2D u_doubleBuffer0;  // rgb the sum of radiance, alpha the number of samples in it
uniform vec2 u_resolution;
uniform int u_frame;

out vec4 color;

#ifdef DOUBLE_BUFFER_0

const int SAMPLES = {job.frame_samples};  // per pixel and frame

void main()
{{
    ivec2 coord = ivec2(gl_FragCoord.xy);
    ivec4 film = film_in(ivec2(u_resolution));
    ivec2 pixel = coord - film.xy;
    color = vec4(0.0);
    if (any(lessThan(pixel, ivec2(0))) || any(greaterThanEqual(pixel, film.zw)))
        return;
    vec4 sum = u_frame > 0 ? texelFetch(u_doubleBuffer0, coord, 0) : vec4(0.0);
    color = trace_samples(sum, uvec2(pixel), vec2(film.zw), 0u, uint(u_frame) * uint(SAMPLES), SAMPLES);
}}

#else

void main()
{{
{shown(job.exposure, "texelFetch(u_doubleBuffer0, ivec2(gl_FragCoord.xy), 0)")}    color = vec4(encoded, 1.0);
}}

#endif
"""
