"""Evaluates one function of the shader library over a grid of inputs, so that tests see the production code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from harness.gpu.context import Program, context
from harness.shader.library import Library

# Rows are laid out in textures of this width: any GL 4.3 device takes it, and it keeps N rows nearly square.
_ROW_WIDTH = 1024


@dataclass(frozen=True, eq=False)
class Picture:
    """An image that a probe's sampler reads: `texels` (H, W, 4), first row first; filtered linearly or not at all;
    whether it repeats in s, else its edge goes on, as it does in t."""

    texels: np.ndarray
    filtered: bool = False
    repeats: bool = False


def evaluate(probe: str, *inputs: np.ndarray, outputs: int = 1, uniforms: Mapping[str, Any] | None = None,
             defines: Mapping[str, object] | None = None, generated: Mapping[str, str] | None = None,
             library: Library | None = None, pictures: Mapping[str, Picture] | None = None) -> np.ndarray:
    """Run `glsl/probes/<probe>` once for each of N rows; returns (N, 4 * outputs) float32.

    `inputs`: arrays of (N, 4), which the probe reads as `input0`, `input1`, …, at its own row; `outputs`: how many
    `output0`, `output1`, … it writes (at most 8). A probe also learns its row from the same texel.
    `defines` come before the source, `generated` holds include files that exist only in memory, such as `scene.glsl`;
    `library` is ours where none is given; `pictures`: by the names of their samplers.

    Raises ShaderError for a probe that does not exist or does not compile, ValueError for inputs of unequal length.
    """
    rows = len(inputs[0])
    if any(np.shape(values) != (rows, 4) for values in inputs):
        raise ValueError(f"every input must be ({rows}, 4), found {[np.shape(values) for values in inputs]}")
    size = (min(rows, _ROW_WIDTH), -(-rows // _ROW_WIDTH))
    program = Program((library or Library()).probe(probe, generated, defines))
    gl = context()
    sources = [gl.texture(size, 4, _texels(values, size), dtype="f4") for values in inputs]
    images = {name: _uploaded(picture) for name, picture in (pictures or {}).items()}
    targets = [gl.texture(size, 4, dtype="f4") for _ in range(outputs)]
    framebuffer = gl.framebuffer(targets)
    try:
        samplers = {**{f"input{unit}": texture for unit, texture in enumerate(sources)}, **images}
        for unit, texture in enumerate(samplers.values()):
            texture.use(unit)
        program.set({**{name: unit for unit, name in enumerate(samplers)}, **(uniforms or {})})
        framebuffer.use()
        gl.scissor = None
        program.draw()
        read = [np.frombuffer(texture.read(), dtype=np.float32).reshape(-1, 4)[:rows] for texture in targets]
    finally:
        resources: list[Any] = [program, framebuffer, *sources, *images.values(), *targets]
        for resource in resources:
            resource.release()
    return np.concatenate(read, axis=1)


def _uploaded(picture: Picture) -> moderngl.Texture:
    height, width = picture.texels.shape[:2]
    data = np.ascontiguousarray(picture.texels, dtype=np.float32)
    texture = context().texture((width, height), 4, data.tobytes(), dtype="f4")
    texture.filter = (moderngl.LINEAR, moderngl.LINEAR) if picture.filtered else (moderngl.NEAREST, moderngl.NEAREST)
    texture.repeat_x, texture.repeat_y = picture.repeats, False
    return texture


def _texels(values: np.ndarray, size: tuple[int, int]) -> bytes:
    padded = np.zeros((size[0] * size[1], 4), dtype=np.float32)
    padded[:len(values)] = values
    return padded.tobytes()
