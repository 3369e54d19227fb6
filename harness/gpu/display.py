"""The display pass on its own: a rendered image as the shader shows it, sRGB-encoded bytes."""

from __future__ import annotations

import moderngl
import numpy as np

from harness.gpu.context import Program, context
from harness.shader.library import Library


def display(image: np.ndarray, exposure: float = 0.0, library: Library | None = None) -> np.ndarray:
    """Run the library's `display.frag` over an image, row 0 at the top; returns (H, W, 3) uint8, `exposure` in stops.

    `image` is a mean (H, W, 3), or (H, W, 4) as the tracer accumulates it: the sum of radiance, and the number of
    samples in it. A pixel without samples is black.

    Raises ValueError for any other shape.
    """
    if image.ndim != 3 or image.shape[2] not in (3, 4):
        raise ValueError(f"an image must be (H, W, 3) or (H, W, 4), found {image.shape}")
    height, width, channels = image.shape
    accumulated = np.ones((height, width, 4), dtype=np.float32)
    accumulated[..., :channels] = image[::-1]
    program = Program((library or Library()).assembled("display.frag"))
    gl = context()
    source = gl.texture((width, height), 4, accumulated.tobytes(), dtype="f4")
    source.filter = (moderngl.NEAREST, moderngl.NEAREST)
    target = gl.texture((width, height), 4, dtype="f1")
    framebuffer = gl.framebuffer([target])
    source.use(0)
    framebuffer.use()
    gl.scissor = None
    program.set({"pingpong0": 0, "exposure": exposure})
    program.draw()
    shown = np.frombuffer(target.read(), dtype=np.uint8).reshape(height, width, 4)
    program.release()
    for resource in (framebuffer, source, target):
        resource.release()
    return np.ascontiguousarray(shown[::-1, :, :3])
