"""The two ways into a tracer: its fragment shader over a triangle, and its compute shader over groups of pixels.

Both fill bands of rows of a target texture with the same bits, but for sums below 1e-36: llvmpipe flushes denormals in
the threads that draw triangles alone.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import Any, Protocol

import moderngl

from harness.errors import MachineError
from harness.gpu.context import Program, context, device, line_offset, set_uniforms, uniforms_of
from harness.gpu.device import ENTRY
from harness.shader.compute import GROUP, as_compute
from harness.shader.source import ShaderSource

ENTRIES = ("fragment", "compute")
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


class Entry(Protocol):
    """A compiled tracer that fills textures."""

    @property
    def uniforms(self) -> frozenset[str]:
        """Names of the uniforms that somebody must set."""

    def set(self, uniforms: Mapping[str, Any]) -> None:
        """Set uniforms; one that the compiler optimised away is left alone."""

    def aim(self, number: int) -> None:
        """Fill target `number` from now on."""

    def draw(self, bottom: int, rows: int) -> None:
        """Fill a band of the target."""

    def release(self) -> None:
        """Free the GL objects; the targets are the caller's."""


class Fragments:
    """A fragment shader, its bands by the scissor test."""

    def __init__(self, source: ShaderSource, targets: list[moderngl.Texture]) -> None:
        """Compile; raises ShaderError naming our file and line."""
        self._program = Program(source)
        self._width = targets[0].width
        self._framebuffers = [context().framebuffer([texture]) for texture in targets]
        self.uniforms = self._program.uniforms
        self.set = self._program.set

    def aim(self, number: int) -> None:
        self._framebuffers[number].use()

    def draw(self, bottom: int, rows: int) -> None:
        gl = context()
        gl.scissor = (0, bottom, self._width, rows)
        self._program.draw()
        gl.scissor = None

    def release(self) -> None:
        self._program.release()
        for framebuffer in self._framebuffers:
            framebuffer.release()


class Groups:
    """A compute shader (glsl/path_tracer.comp), its bands by a uniform."""

    def __init__(self, source: ShaderSource, targets: list[moderngl.Texture]) -> None:
        """Compile; raises ShaderError naming our file and line."""
        gl = context()
        try:
            self._program = gl.compute_shader(source.text)
        except moderngl.Error as error:
            raise source.explain(str(error), line_offset(gl)) from None
        self._targets = targets
        self.uniforms = uniforms_of(self._program) - {"band", "stride", "accumulated"}

    def set(self, uniforms: Mapping[str, Any]) -> None:
        set_uniforms(self._program, uniforms)

    def aim(self, number: int) -> None:
        self._targets[number].bind_to_image(0, read=False, write=True)
        self.set({"accumulated": 0})

    def draw(self, bottom: int, rows: int) -> None:
        across, up = -(-self._targets[0].width // GROUP), -(-rows // GROUP)
        self.set({"band": (bottom, bottom + rows), "stride": stride(across * up)})
        self._program.run(across, up)
        context().memory_barrier()

    def release(self) -> None:
        self._program.release()


def stride(groups: int) -> int:
    """A step that leads through all of `groups`, any run of them spread over the whole: near the golden section of
    their number, and of no divisor in common with it; less where its multiples would not fit into 32 bits."""
    wanted = min(round(groups * GOLDEN), (2**32 - 1) // groups)
    return next(step for step in range(max(1, wanted), 0, -1) if math.gcd(step, groups) == 1)


def chosen() -> str:
    """The entry by which our own tracer is run: that of the device, or the environment's. MachineError for another."""
    name = os.environ.get(ENTRY, "").strip() or device().entry
    if name not in ENTRIES:
        raise MachineError(f"{ENTRY}: expected {' or '.join(ENTRIES)}, found '{name}'; unset it, and the device's own "
                           "is taken")
    return name


def entry(source: ShaderSource, targets: list[moderngl.Texture]) -> Entry:
    """Compile a tracer for these targets, all of one size; one with a `main` of its own is a fragment shader."""
    compute = as_compute(source) if chosen() == "compute" else None
    return Groups(compute, targets) if compute else Fragments(source, targets)
