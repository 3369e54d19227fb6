"""Runs the taps of glsl/probes/tap.glsl: what the production shader's functions are given and return, path by path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from harness.errors import ShaderError
from harness.gpu.context import Program, context
from harness.gpu.samplers import Samplers
from harness.scene.model import Scene
from harness.shader.functions import Function, functions
from harness.shader.hosts.base import Pass
from harness.shader.hosts.native import NATIVE
from harness.shader.library import GENERATED, Library
from harness.shader.scene.chunk import scene_chunk
from harness.shader.source import ShaderSource

# The file with `main`, as the taps include it.
INCLUDED_MAIN = "tap/main.glsl"
# Records by name, as probes/tap/records.glsl numbers them.
VERTEX_RECORDS = ("origin", "ray", "normal", "place", "facing", "direction", "weight", "diffuse", "glossy", "light",
                  "surface", "states", "lobe", "numbers", "brdf", "tangent", "bitangent", "about", "turned", "lifted",
                  "met", "drawn", "taken")
PATH_RECORDS = ("film", "stream", "seed", "generator", "first", "time", "eye", "gaze", "given", "returned", "asked",
                "pixel", "finite", "pose", "pose_normal")
# Functions that the taps may call by themselves, where a library has them with these parameters.
OPTIONAL = {
    "TAP_HAS_BASIS": ("vec3 to_world(vec3 local, vec3 axis)",),
    "TAP_HAS_ABOUT": ("vec3 direction_about(vec3 axis, float cos_theta, float u)",),
    "TAP_HAS_PDFS": ("float pdf_lobe(float cos_to_axis, float alpha)", "float pdf_cosine(float cos_theta)"),
    "TAP_HAS_EVAL": ("vec3 eval_phong(Material m, float cos_to_mirror)",),
    "TAP_HAS_OFFSET": ("vec3 offset_origin(vec3 p, vec3 n)",),
    "TAP_HAS_FINITE": ("bool is_finite(vec3 v)",),
    "TAP_HAS_SAMPLERS": ("vec3 sample_uniform(vec3 n, vec2 u)", "vec3 sample_cosine(vec3 n, vec2 u)",
                     "vec3 sample_lobe(vec3 axis, float alpha, vec2 u)"),
}
Records = dict[str, np.ndarray]


@dataclass(frozen=True)
class Look:
    """One pass that is looked at: `samples` per pixel from index `first` on, of which number `tapped` is observed.

    `number` of the pass since the sum was nothing; `previous`, (H, W, 4) float32, row 0 at the top, is what the
    previous pass left. `moment`, in [0, 1) of the shutter's interval: where all paths are put after their own is drawn.
    """

    replica: int
    first: int
    samples: int
    tapped: int
    number: int
    previous: np.ndarray
    moment: float | None = None


@dataclass(frozen=True, eq=False)
class Observed:
    """What a look saw of each path, top row first: what the pass leaves, (N, 4) float32, the bits of the production
    shader; the records of paths; those of each vertex, zero where a path has none. All (N, 4) float32."""

    accumulated: np.ndarray
    paths: Records
    vertices: list[Records]


class Tap:
    """The tapped shader of one scene, strategy and library; holds the program, the scene's images and the targets."""

    def __init__(self, scene: Scene, strategy: str, library: Library) -> None:
        """Compile. ShaderError where the library does not compile, or not with the taps; HarnessError as
        `Library.tracer`."""
        self.scene = scene
        self.source = library.tracer(scene, strategy)
        self.functions: Mapping[str, Function] = functions(self.source)
        self._program = _compile(tapped(scene, strategy, library), self.source)
        self._samplers = Samplers(scene, self.source)
        gl = context()
        size = scene.width, scene.height
        self._pingpong = [gl.texture(size, 4, dtype="f4") for _ in range(2)]
        for texture in self._pingpong:
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._framebuffer = gl.framebuffer([self._pingpong[1]])
        records = len(PATH_RECORDS) + scene.max_depth * len(VERTEX_RECORDS)
        self._empty = bytes(scene.width * scene.height * records * 16)
        self._buffer = gl.buffer(self._empty)

    def observe(self, look: Look, shape: int = 0, point: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Observed:
        """Draw the pass; `shape` and `point` are those of the record `pose`."""
        gl = context()
        width, height, depth = self.scene.width, self.scene.height, self.scene.max_depth
        self._buffer.write(self._empty)
        self._buffer.bind_to_storage_buffer(0)
        self._pingpong[0].write(np.ascontiguousarray(look.previous[::-1], dtype=np.float32).tobytes())
        self._pingpong[0].use(0)
        # As the native host tells it, so that the shader itself finds the pass's first sample.
        now = Pass(look.number, look.first, look.samples, look.replica)
        self._program.set({NATIVE.previous: 0, **self._samplers.bind(1), **NATIVE.uniforms(now),
                           "tap_sample": look.tapped, "tap_vertices": depth, "tap_shape": shape, "tap_point": point,
                           "tap_moment": -1.0 if look.moment is None else look.moment})
        gl.scissor = None
        self._framebuffer.use()
        self._framebuffer.clear()  # what is blended with must be finite
        self._program.draw()
        gl.memory_barrier()
        left = np.frombuffer(self._pingpong[1].read(), dtype=np.float32).reshape(height, width, 4)[::-1]
        rows = np.frombuffer(self._buffer.read(), dtype=np.float32).reshape(height, width, -1, 4)[::-1]
        paths, rest = np.split(rows.reshape(width * height, -1, 4), [len(PATH_RECORDS)], axis=1)
        vertices = rest.reshape(width * height, depth, len(VERTEX_RECORDS), 4)
        return Observed(left.reshape(-1, 4), {name: paths[:, index] for index, name in enumerate(PATH_RECORDS)},
                        [{name: vertices[:, number, index] for index, name in enumerate(VERTEX_RECORDS)}
                         for number in range(depth)])

    def release(self) -> None:
        """Free the GL objects."""
        self._program.release()
        self._samplers.release()
        resources: list[Any] = [self._framebuffer, self._buffer, *self._pingpong]
        for resource in resources:
            resource.release()


def tapped(scene: Scene, strategy: str, library: Library) -> ShaderSource:
    """The production shader with its taps."""
    generated = {GENERATED: scene_chunk(scene, strategy)}
    whole = functions(library.assembled(library.main, generated))
    has = {name: int(all(_has(whole, signature) for signature in signatures))
           for name, signatures in OPTIONAL.items()}
    has["ENDS_BY_DIRECTION"] = 0  # so that a path ends where its throughput does, and is judged by that
    has["TAP_HAS_STATE"] = int("uint rng_state;" in library.assembled("lib/random.glsl", generated).text)
    return library.assembled("probes/tap.glsl", {**generated, INCLUDED_MAIN: f'#include "{library.main}"\n'}, has)


def _has(whole: Mapping[str, Function], signature: str) -> bool:
    """Whether a function of that name takes and returns these types, whatever its parameters are called."""
    name = signature.partition("(")[0].split()[1]
    return name in whole and types(whole[name].signature) == types(signature)


def types(signature: str) -> list[str]:
    """The type that is returned and those of the parameters."""
    head, _, takes = signature.partition("(")
    return [head.split()[0], *(" ".join(each.split()[:-1]) for each in takes.rstrip(")").split(",") if each.strip())]


def _compile(taps: ShaderSource, production: ShaderSource) -> Program:
    """ShaderError of the production shader where that is what does not compile; else of what the taps do not fit."""
    try:
        return Program(taps)
    except ShaderError as error:
        Program(production).release()
        raise ShaderError(f"the taps do not fit this library ({error}); keep the names and parameters of the functions "
                          "that it takes the place of") from None
