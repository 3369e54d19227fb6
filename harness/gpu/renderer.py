"""The tracer's renderer: a scene and a strategy become batches, through the ping-pong shader."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import moderngl
import numpy as np

from harness.errors import HarnessError, ShaderError
from harness.files import data_dir
from harness.gpu.context import Program, context, describe_gl
from harness.gpu.samplers import Samplers
from harness.samples.estimate import Batch
from harness.samples.keys import code_digest, digest
from harness.samples.traits import Traits
from harness.scene.model import Scene
from harness.shader.scene.chunk import scene_chunk
from harness.shader.scene.displaced import march_steps
from harness.shader.source import ShaderSource, assemble
from harness.shader.strategies import check_strategy

# Past about 65,535 iterations of all loops of one invocation llvmpipe leaves the loop without an error and the
# result is wrong; half of that leaves room for every loop the driver may add.
MAX_ITERATIONS = 32_768
# Fewer samples in a pass cost launch overhead and lanes that idle while their neighbours finish: 64 are 2 to 4 %
# slower on spheres and cornell, 32 are 3 to 9 %. Twice as many gain up to 6 % but no batch of the store is that long.
MAX_SAMPLES_PER_PASS = 128
# A float32 sum of this many samples is off by 8e-6 at worst, which is when all are equal (1.5e-5 for twice as many);
# then it is flushed to float64.
FLUSH_SAMPLES = 512
# The shader numbers replicas and the samples of each by uint; beyond, streams would repeat.
SEEDS = 2**32
# One draw should take no longer: desktop drivers reset a device that is busy for about two seconds.
DRAW_SECONDS = 0.25
# An endless loop shows as draws that take so long at less than so many pixel-samples per second: under a hundredth
# of what the slowest scene here does on one core. Desktop drivers give up after these seconds, llvmpipe goes on.
STUCK_SECONDS, STUCK_RATE = 2.0, 2000
# Pixel-samples of the first draw, before anything is known about the device: 64² pixels of 16 samples.
FIRST_DRAW = 64 * 64 * 16


def tracer_source(scene: Scene, strategy: str) -> ShaderSource:
    """The self-contained shader for one scene and strategy."""
    check_strategy(scene, strategy)
    return assemble("path_tracer.frag", data_dir("glsl"), generated={"scene.glsl": scene_chunk(scene, strategy)})


class TracerRenderer:
    """Renders batches of one scene with one strategy; holds the GL program, the scene's images and the two
    ping-pong textures.

    Bitwise reproducible: a batch depends on scene, strategy, replica and sample range, never on tiles, passes or
    threads.
    """

    traits = Traits()

    def __init__(self, scene: Scene, strategy: str, source: ShaderSource | None = None) -> None:
        """Compile; `source` replaces the shader (an own shader under test, a mutant). Raises ShaderError."""
        self.scene = scene
        self.strategy = check_strategy(scene, strategy)
        self.source = source or tracer_source(scene, strategy)
        self._program = Program(self.source)
        self._samplers = Samplers(scene)
        self._size = (scene.width, scene.height)
        gl = context()
        self._textures = [gl.texture(self._size, 4, dtype="f4") for _ in range(2)]
        for texture in self._textures:
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._framebuffers = [gl.framebuffer([texture]) for texture in self._textures]
        iterations = scene.max_depth * (1 + march_steps(scene.shapes))  # of one sample, at most
        self._max_samples = max(1, min(MAX_SAMPLES_PER_PASS, MAX_ITERATIONS // iterations))
        self._draw_work = FIRST_DRAW
        self._compiled = False  # drivers compile in the first draw, whose time tells nothing

    @property
    def identity(self) -> dict[str, str]:
        """What a batch depends on besides replica and sample range, for the store."""
        return {
            "renderer": "glsl",
            "scene": self.scene.content_hash,
            "strategy": self.strategy.name,
            "shader": digest(self.source.text, 16),
            "code": code_digest(__name__),
            **describe_gl(),
        }

    def render_batch(self, replica: int, start: int, count: int,
                     advance: Callable[[int], None] | None = None) -> Batch:
        """Samples start … start+count-1 of one replica; `advance(n)` is told of every n samples per pixel done."""
        if count < 1 or start < 0 or start + count > SEEDS or not 0 <= replica < SEEDS:
            raise HarnessError(f"samples and replicas are numbered from 0 to {SEEDS - 1}, found {count} samples from "
                               f"{start} of replica {replica}; ask for at least one, and none beyond")
        began = time.process_time()
        total = np.zeros((self.scene.height, self.scene.width, 4))
        for first in range(start, start + count, FLUSH_SAMPLES):
            samples = min(FLUSH_SAMPLES, start + count - first)
            total += self._accumulate(replica, first, samples, advance)
        # What alpha says is believed where it can be a number of samples; a shader under test may write anything.
        alpha = total[..., 3]
        believed = np.isfinite(total).all(axis=-1) & (alpha >= 0) & (alpha <= count) & (alpha == np.rint(alpha))
        total[~believed] = 0
        finite = total[..., 3:]
        mean = np.divide(total[..., :3], finite, out=np.zeros_like(total[..., :3]), where=finite > 0)
        rejected = count * self.scene.width * self.scene.height - int(finite.sum())
        return Batch(mean.astype(np.float32), count, rejected, time.process_time() - began)

    def release(self) -> None:
        """Free the GL objects; the renderer must not be used afterwards."""
        self._program.release()
        self._samplers.release()
        for framebuffer, texture in zip(self._framebuffers, self._textures, strict=True):
            framebuffer.release()
            texture.release()

    def _accumulate(self, replica: int, first: int, samples: int, advance: Callable[[int], None] | None) -> np.ndarray:
        """One ping-pong accumulation from zero, (H, W, 4) float64, row 0 at the top."""
        gl = context()
        source, target = 0, 1
        done = 0
        numpass = 0
        while done < samples:
            height = min(self.scene.height, 64)  # bands any lower would starve the rasteriser's threads
            fitting = self._draw_work // (self.scene.width * height)
            count = max(1, min(self._max_samples, samples - done, fitting))
            self._textures[source].use(0)
            self._framebuffers[target].use()
            self._program.set({
                "pingpong0": 0, **self._samplers.bind(1), "numpass": numpass, "samples_per_pass": count,
                "replica": replica,
                # The shader adds numpass * samples_per_pass; passes may differ in size, so it is taken off here.
                "first_sample": (first + done - numpass * count) % SEEDS,
            })
            for bottom, rows in self._bands(count):
                gl.scissor = (0, bottom, self.scene.width, rows)
                self._timed_draw(gl, rows * self.scene.width * count)
            gl.scissor = None
            source, target = target, source
            done += count
            numpass += 1
            if advance:
                advance(count)
        data = np.frombuffer(self._textures[source].read(), dtype=np.float32)
        return data.reshape(self.scene.height, self.scene.width, 4)[::-1].astype(np.float64)

    def _bands(self, samples: int) -> Iterator[tuple[int, int]]:
        """Horizontal bands (bottom row, rows) of at most `_draw_work` pixel-samples, as it stands at each band."""
        bottom = 0
        while bottom < self.scene.height:
            rows = max(1, min(self.scene.height - bottom, self._draw_work // (self.scene.width * samples)))
            yield bottom, rows
            bottom += rows

    def _timed_draw(self, gl: moderngl.Context, work: int) -> None:
        began, busy = time.perf_counter(), time.process_time()
        self._program.draw()
        gl.finish()
        seconds, busy = time.perf_counter() - began, time.process_time() - busy
        # Of a process that was stopped for a while (Ctrl-Z, a laptop asleep) the clock alone tells nothing.
        if self._compiled and min(seconds, busy) > max(STUCK_SECONDS, work / STUCK_RATE):
            raise ShaderError(f"{self.source.files[0][0]}: {work} samples took {seconds:.1f} s, as with a loop without "
                              "end; give each loop a bound that ends it")
        self._compiled = True
        if seconds > DRAW_SECONDS:
            self._draw_work = max(1, work // 2)
        elif seconds < DRAW_SECONDS / 4 and work * 4 > self._draw_work:
            self._draw_work = work * 4
