"""glslViewer: one file, which is its double buffer and its picture."""

from __future__ import annotations

from harness.shader.exports.base import Job, fitted, shown

HOST = "glslviewer"
VERSION = "#version 420"  # it must be the file's first characters


def export(job: Job) -> dict[str, str]:
    """`NAME.frag`. HarnessError for a scene with images."""
    job.refuse_images("export to glsl, and bind them as its comments say")
    width, height = job.scene.width, job.scene.height
    name = f"{job.name}.frag"
    parts = [
        f"{VERSION}\n{job.head(f'glslViewer {name} -w {width} -h {height}')}",
        job.tracer().written(), fitted(width, height), job.encode(), _mains(job)]
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
