"""What every export starts from: a scene and a strategy, as readable GLSL and as words."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata

from harness.scene.model import Scene
from harness.scene.strategies import parse_strategy
from harness.shader.exports.readable import Text, split
from harness.shader.library import GENERATED, Library
from harness.shader.scene.chunk import scene_chunk
from harness.shader.scene.lights import path_iterations
from harness.shader.scene.literals import in_comment, number

# Iterations of all loops of one invocation that no driver leaves early: see harness/gpu/device.py.
MAX_ITERATIONS = 32_768
# The file that hosts begin with in place of path_tracer.frag: their own `main` stands below what it includes.
_ROOT = "tracer.glsl"
_DISPLAY = "display.frag"
# The library's one use of `precise`, which GLSL ES 3.00 has not, and what keeps a ray from dividing by zero without.
PRECISE = """\
    // The addend keeps a ray parallel to a face from dividing by zero: infinity minus infinity below would make every
    // such ray hit. `precise`, or the compiler may move it into the sum of the dot product, where it vanishes.
    precise vec3 direction = vec3(dot(row_x.xyz, d), dot(row_y.xyz, d), dot(row_z.xyz, d)) + 1e-30;
"""
CHOSEN = """\
    // A ray parallel to a face must not divide by zero: infinity minus infinity below would make every such ray hit.
    vec3 direction = vec3(dot(row_x.xyz, d), dot(row_y.xyz, d), dot(row_z.xyz, d));
    direction = mix(direction, vec3(1e-30), equal(direction, vec3(0.0)));
"""
# Sums and products of constants that wrap around: a translator to WGSL, which refuses them, is told their values.
_WRAPPING = re.compile(r"\bNOISE_X \+ NOISE_Y\b|\b(?P<octave>\d+)u \* NOISE_OCTAVE\b")
NOISE_X, NOISE_Y, NOISE_OCTAVE = 0x85EBCA77, 0xC2B2AE3D, 0x9E3779B9  # glsl/lib/noise.glsl


@dataclass(frozen=True)
class Job:
    """What is exported. `samples`: per pixel that are asked of a frame; `exposure`: of the display, in stops."""

    scene: Scene
    strategy: str
    library: Library
    samples: int
    exposure: float

    @property
    def name(self) -> str:
        """The scene's, as a file name takes it."""
        return re.sub(r"[^\w.-]+", "_", self.scene.name).strip("_.") or "scene"

    @property
    def frame_samples(self) -> int:
        """Samples per pixel of one frame: as asked, or fewer where paths are so long that drivers would break off."""
        iterations = path_iterations(self.scene, parse_strategy(self.strategy))
        return max(1, min(self.samples, MAX_ITERATIONS // iterations))

    def tracer(self, generated: Mapping[str, str] | None = None, *, es: bool = False) -> Text:
        """`trace_samples` and all that it needs. `generated`: texts in place of library files; `es`: for GLSL ES 3.00,
        which has no `precise`."""
        scene = scene_chunk(self.scene, self.strategy)
        root = f'#include "{GENERATED}"\n#include "lib/path.glsl"\n'
        text = self.library.assembled(_ROOT, {GENERATED: scene, _ROOT: root, **(generated or {})}).text
        if es:
            text = _WRAPPING.sub(_wrapped, text.replace(PRECISE, CHOSEN).replace("precise ", ""))
        return split(text).only(["trace_samples"])

    def encode(self) -> str:
        """GLSL: the display's encoding."""
        return split(self.library.assembled(_DISPLAY).text).only(["encode_srgb"]).written()

    def head(self, *how: str, mark: str = "// ") -> str:
        """A comment: from what this was made, and `how` to load it, a line each."""
        lines = [f"The path tracer with the scene '{in_comment(self.scene.name)}' and the strategy '{self.strategy}', "
                 f"{self.scene.width} x {self.scene.height}.",
                 f"Written by glsl-validation-harness {metadata.version('glsl-validation-harness')} "
                 f"(scene {self.scene.content_hash}).", "", *how]
        return "".join(f"{mark}{line}".rstrip() + "\n" for line in lines)


def _wrapped(found: re.Match[str]) -> str:
    whole = int(found["octave"]) * NOISE_OCTAVE if found["octave"] else NOISE_X + NOISE_Y
    return f"0x{whole % 2**32:08x}u"


def fitted(width: int, height: int) -> str:
    """GLSL: the film's place in a window of any size; the whole window where that has the film's aspect."""
    return f"""// Corner and size, in pixels, of the scene's film in the middle of a window, as large as fits.
ivec4 film_in(ivec2 window)
{{
    const ivec2 FILM = ivec2({width}, {height});
    bool narrow = window.x * FILM.y <= window.y * FILM.x;
    ivec2 size = narrow ? ivec2(window.x, window.x * FILM.y / FILM.x) : ivec2(window.y * FILM.x / FILM.y, window.y);
    return ivec4((window - size) / 2, size);
}}
"""


def shown(exposure: float, sum_of_radiance: str) -> str:
    """GLSL statements that declare `mean`, encoded, from an expression for the sum and its number of samples."""
    return f"""    vec4 sum = {sum_of_radiance};
    vec3 mean = sum.a > 0.0 ? sum.rgb / sum.a : vec3(0.0);
    vec3 encoded = encode_srgb(mean * exp2({number(exposure)}));
"""
