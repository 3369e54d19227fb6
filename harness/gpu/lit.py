"""Runs glsl/probes/lit.frag: what a library's functions of light sampling make of given vertices of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.errors import ShaderError
from harness.gpu.context import Program, context
from harness.gpu.samplers import Samplers
from harness.scene.model import Scene
from harness.shader.library import GENERATED, Library
from harness.shader.scene.chunk import scene_chunk

ROW_WIDTH = 1024
# vec4 that a draw gives, and draws.
OUTPUTS, PARTS = 8, 2


@dataclass(frozen=True, eq=False)
class LitVertices:
    """Vertices of paths, N rows: origins off their surface, normals, directions to the viewer, (N, 3); of the material
    kd, ks, (N, 3), alpha and p_glossy, (N,). `keys` (N,), below 2**24: by which each has numbers of its own."""

    origin: np.ndarray
    normal: np.ndarray
    viewer: np.ndarray
    kd: np.ndarray
    ks: np.ndarray
    alpha: np.ndarray
    p_glossy: np.ndarray
    keys: np.ndarray

    def __len__(self) -> int:
        return len(self.keys)


def light_answers(scene: Scene, strategy: str, library: Library, at: LitVertices,
                  moment: float = 0.0) -> np.ndarray | None:
    """What the probe says of each vertex, (N, 64) float32: eight vec4 of part 0, then those of part 1.

    `moment`, in [0, 1): of the shutter's interval. None where the library has other functions than ours, so that the
    probe does not fit them; ShaderError where it does not compile by itself.
    """
    generated = {GENERATED: scene_chunk(scene, strategy)}
    try:
        source = library.probe("lit.frag", generated)
        program = Program(source)
    except ShaderError:
        Program(library.tracer(scene, strategy)).release()
        return None
    rows = [np.c_[at.origin, at.keys], np.c_[at.normal, at.p_glossy], np.c_[at.viewer, at.alpha],
            np.c_[at.kd, np.zeros(len(at))], np.c_[at.ks, np.zeros(len(at))]]
    size = (min(len(at), ROW_WIDTH), -(-len(at) // ROW_WIDTH))
    gl = context()
    samplers = Samplers(scene, source)
    inputs = [gl.texture(size, 4, _padded(values, size), dtype="f4") for values in rows]
    targets = [gl.texture(size, 4, dtype="f4") for _ in range(OUTPUTS)]
    framebuffer = gl.framebuffer(targets)
    try:
        for unit, texture in enumerate(inputs):
            texture.use(unit)
        found = []
        for part in range(PARTS):
            program.set({**{f"input{unit}": unit for unit in range(len(inputs))}, **samplers.bind(len(inputs)),
                         "moment": moment, "part": part})
            framebuffer.use()
            gl.scissor = None
            program.draw()
            found += [np.frombuffer(texture.read(), dtype=np.float32).reshape(-1, 4)[:len(at)] for texture in targets]
    finally:
        resources: list[Any] = [program, samplers, framebuffer, *inputs, *targets]
        for resource in resources:
            resource.release()
    return np.concatenate(found, axis=1)


def _padded(values: np.ndarray, size: tuple[int, int]) -> bytes:
    whole = np.zeros((size[0] * size[1], 4), dtype=np.float32)
    whole[:len(values)] = values
    return whole.tobytes()
