"""The tracer's renderer: a scene and a strategy become batches, through the ping-pong shader."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness.errors import HarnessError
from harness.gpu.context import describe_gl, device
from harness.gpu.pingpong import PingPong
from harness.gpu.samplers import Samplers
from harness.samples.cost import Watch, cpu
from harness.samples.estimate import Batch
from harness.samples.keys import code_digest, digest
from harness.samples.spent import spent
from harness.samples.traits import Traits
from harness.scene.model import Scene
from harness.scene.strategies import check_strategy, parse_strategy
from harness.shader.hosts.base import SEEDS
from harness.shader.hosts.native import NATIVE
from harness.shader.library import OURS
from harness.shader.samplers import DEFAULT, Sampler, sampler_named
from harness.shader.scene.lights import path_iterations
from harness.shader.source import ShaderSource


class TracerRenderer:
    """Renders batches of one scene with one strategy; holds the GL program, the scene's images and the two
    ping-pong textures.

    Bitwise reproducible: a batch depends on scene, strategy, replica and sample range, never on tiles, passes or
    threads.
    """

    @spent("tracer")
    def __init__(self, scene: Scene, strategy: str, source: ShaderSource | None = None,
                 sampler: Sampler | None = None) -> None:
        """Compile; `source` replaces the shader (an own shader under test, a mutant, one with another sampler, which is
        then said beside it). Raises ShaderError."""
        self.scene = scene
        self.sampler = sampler or sampler_named(DEFAULT)
        self.traits = Traits(independent_batches=self.sampler.independent_batches)
        self.strategy = check_strategy(scene, strategy)
        self.source = source or OURS.tracer(scene, strategy)
        fitted = device().fitted(self.source)
        self._samplers = Samplers(scene, fitted)
        iterations = path_iterations(scene, parse_strategy(strategy))
        try:
            self._pingpong = PingPong(fitted, (scene.width, scene.height), NATIVE,
                                      self._samplers.bind, iterations)
        except BaseException:
            self._samplers.release()
            raise

    @property
    def identity(self) -> dict[str, str]:
        """What a batch depends on besides replica and sample range, for the store."""
        return {
            "renderer": "glsl",
            "scene": self.scene.content_hash,
            "strategy": self.strategy.name,
            **({"sampler": self.sampler.name} if self.sampler.name != DEFAULT else {}),
            "shader": digest(self.source.text, 16),
            "code": code_digest(__name__),
            **describe_gl(),
        }

    @spent("tracer")
    def render_batch(self, replica: int, start: int, count: int,
                     advance: Callable[[float], None] | None = None) -> Batch:
        """Samples start … start+count-1 of one replica; `advance(n)` is told of every n samples per pixel done."""
        if count < 1 or start < 0 or start + count > SEEDS or not 0 <= replica < SEEDS:
            raise HarnessError(f"samples and replicas are numbered from 0 to {SEEDS - 1}, found {count} samples from "
                               f"{start} of replica {replica}; ask for at least one, and none beyond")
        watch, drawn = Watch(), self._pingpong.gpu_seconds
        total, counted = NATIVE.sums(self._pingpong.total(replica, start, count, advance), count)
        mean = np.divide(total, counted, out=np.zeros_like(total), where=counted > 0)
        rejected = count * self.scene.width * self.scene.height - int(counted.sum())
        used = device()
        if used.clock == "cpu":
            cost = watch.cost(f"{used.name}, {cpu()}")
        else:
            cost = watch.cost(used.name, self._pingpong.gpu_seconds - drawn, "gpu")
        return Batch(mean.astype(np.float32), count, rejected, cost)

    def release(self) -> None:
        """Free the GL objects; the renderer must not be used afterwards."""
        self._pingpong.release()
        self._samplers.release()
