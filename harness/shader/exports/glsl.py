"""The harness's own contract: the tracer that `harness render` runs, in one file, and the display."""

from __future__ import annotations

from harness.shader.exports.base import Job
from harness.shader.exports.images import require_files
from harness.shader.exports.readable import split
from harness.shader.scene.literals import number
from harness.shader.source import GLSL_VERSION

HOST = "glsl"


def export(job: Job) -> dict[str, str]:
    """`NAME.frag`, and `NAME.display.frag` that shows what it sums. HarnessError as `require_files`."""
    tracer = split(job.library.tracer(job.scene, job.strategy).text).only(["main"]).written()
    require_files(tracer)
    display = split(job.library.assembled("display.frag").text).only(["main"]).written()
    display = display.replace("uniform float exposure = 0.0;", f"uniform float exposure = {number(job.exposure)};")
    head = job.head("For any host that draws passes into two float textures in turn; see the end of this file.")
    return {f"{job.name}.frag": f"{GLSL_VERSION}\n{head}\n{tracer}",
            f"{job.name}.display.frag": f"{GLSL_VERSION}\n{head}\n{display}"}
