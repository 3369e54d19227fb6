"""Ping-pong: a tracer run pass by pass, each reading what the pass before left, and summed in float64."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping

import moderngl
import numpy as np

from harness.errors import ShaderError
from harness.gpu.context import context, device
from harness.gpu.entries import entry
from harness.shader.hosts.base import Host, Pass
from harness.shader.source import ShaderSource
from harness.shader.uniforms import uniforms

# Fewer samples in a pass cost launch overhead and lanes that idle while their neighbours finish: 64 are 2 to 4 %
# slower on spheres and cornell, 32 are 3 to 9 %. Twice as many gain up to 6 % but no batch of the store is that long.
MAX_SAMPLES_PER_PASS = 128
# A float32 sum of this many samples is off by 8e-6 at worst, which is when all are equal (1.5e-5 for twice as many);
# then it is flushed to float64.
FLUSH_SAMPLES = 512
# One draw should take no longer: desktop drivers reset a device that is busy for about two seconds.
DRAW_SECONDS = 0.25
# An endless loop shows as draws that take so long at less than so many pixel-samples per second: under a hundredth
# of what the slowest scene here does on one core. Desktop drivers give up after these seconds, llvmpipe goes on.
STUCK_SECONDS, STUCK_RATE = 2.0, 2000
# Pixel-samples of the first draw, before anything is known about the device: 64² pixels of 16 samples.
FIRST_DRAW = 64 * 64 * 16

# Binds a shader's images to texture units from the given one on; returns the values of their uniforms.
Bind = Callable[[int], Mapping[str, int]]


class PingPong:
    """Holds the GL program and the two textures that passes are drawn into.

    The sum does not depend on how it is cut into passes, bands and draws, as long as the shader's samples do not.
    """

    def __init__(self, source: ShaderSource, size: tuple[int, int], host: Host, bind: Bind, iterations: int) -> None:
        """Compile; `size`: (width, height); `iterations`: of all the shader's loops for one sample, at most.

        Raises ShaderError, for a uniform that nobody sets as well.
        """
        self._source, self._host, self._bind = source, host, bind
        self._width, self._height = size
        gl = context()
        self._textures = [gl.texture(size, 4, dtype="f4") for _ in range(2)]
        for texture in self._textures:
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        try:
            self._program = entry(source, self._textures)
            try:
                self._require_set()
            except BaseException:
                self._program.release()
                raise
        except BaseException:
            self._release_textures()
            raise
        self.max_samples = max(1, min(MAX_SAMPLES_PER_PASS, device().max_iterations // iterations))
        self._draw_work = FIRST_DRAW
        self.gpu_seconds = 0.0  # of all draws so far, where the device has a clock of its own
        self._compiled = False  # drivers compile in the first draw, whose time tells nothing

    def total(self, replica: int, start: int, count: int, advance: Callable[[float], None] | None) -> np.ndarray:
        """What samples start … start+count-1 of a replica leave, (H, W, 4) float64, row 0 at the top."""
        total = np.zeros((self._height, self._width, 4))
        for first in range(start, start + count, FLUSH_SAMPLES):
            total += self._accumulate(replica, first, min(FLUSH_SAMPLES, start + count - first), advance)
        return total

    def release(self) -> None:
        """Free the GL objects."""
        self._program.release()
        self._release_textures()

    def _release_textures(self) -> None:
        for texture in self._textures:
            texture.release()

    def _require_set(self) -> None:
        """ShaderError for a uniform without a value of its own that the picture depends on and nobody sets: a sampler
        would read `pingpong0` instead, a number would be 0."""
        known = [self._host.previous, *self._host.uniforms(Pass(0, 0, 1, 0)), *self._bind(1)]
        declared = uniforms(self._source)
        unset = sorted(name for name in self._program.uniforms.difference(known)
                       if name not in declared or not declared[name].initialised)
        if unset:
            first, *others = unset
            where = declared[first].where if first in declared else self._source.files[0][0]
            also = f" ({', '.join(others)} neither)" if others else ""
            raise ShaderError(f"{where}: nothing sets the uniform '{first}'{also}, so the image is arbitrary; give it "
                              "a value where it is declared, or make it a constant (textures of one's own cannot "
                              f"be bound); the harness sets {', '.join(known)}")

    def _accumulate(self, replica: int, first: int, samples: int,
                    advance: Callable[[float], None] | None) -> np.ndarray:
        """One ping-pong accumulation from zero, (H, W, 4) float64, row 0 at the top."""
        gl = context()
        source, target = 0, 1
        done = 0
        numpass = 0
        while done < samples:
            height = min(self._height, device().least_rows)
            fitting = self._draw_work // (self._width * height)
            count = max(1, min(self.max_samples, samples - done, fitting))
            self._textures[source].use(0)
            self._program.aim(target)
            told = self._host.uniforms(Pass(numpass, first + done, count, replica))
            self._program.set({self._host.previous: 0, **self._bind(1), **told})
            for bottom, rows in self._bands(count):
                self._timed_draw(gl, bottom, rows, count)
            source, target = target, source
            done += count
            numpass += 1
            if advance:
                advance(count)
        data = np.frombuffer(self._textures[source].read(), dtype=np.float32)
        return data.reshape(self._height, self._width, 4)[::-1].astype(np.float64)

    def _bands(self, samples: int) -> Iterator[tuple[int, int]]:
        """Horizontal bands (bottom row, rows) of at most `_draw_work` pixel-samples, as it stands at each band."""
        bottom = 0
        while bottom < self._height:
            rows = max(1, min(self._height - bottom, self._draw_work // (self._width * samples)))
            yield bottom, rows
            bottom += rows

    def _timed_draw(self, gl: moderngl.Context, bottom: int, rows: int, samples: int) -> None:
        work = rows * self._width * samples
        began, busy = time.perf_counter(), time.process_time()
        if device().clock == "gpu":
            query = gl.query(time=True)
            with query:
                self._program.draw(bottom, rows)
            spent = query.elapsed * 1e-9  # waits for the draw, in which this process is idle
            self.gpu_seconds += spent
            seconds = time.perf_counter() - began
        else:
            self._program.draw(bottom, rows)
            gl.finish()
            seconds = time.perf_counter() - began
            # Of a process that was stopped for a while (Ctrl-Z, a laptop asleep) the clock alone tells nothing.
            spent = min(seconds, time.process_time() - busy)
        if self._compiled and spent > max(STUCK_SECONDS, work / STUCK_RATE):
            raise ShaderError(f"{self._source.files[0][0]}: {work} samples took {seconds:.1f} s, as with a loop "
                              "without end; give each loop a bound that ends it")
        self._compiled = True
        if seconds > DRAW_SECONDS:
            self._draw_work = max(1, work // 2)
        elif seconds < DRAW_SECONDS / 4 and work * 4 > self._draw_work:
            self._draw_work = work * 4
