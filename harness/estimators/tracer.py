"""Our tracer as an estimator: a strategy, a sampler, and our GLSL or a library made from it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from harness.errors import HarnessError
from harness.gpu.renderer import TracerRenderer
from harness.scene import Scene, SceneFile, load
from harness.scene.strategies import check_strategy
from harness.scene.without import FEATURES
from harness.shader.library import GENERATED, OURS, Library
from harness.shader.own_files import own_library
from harness.shader.samplers import DEFAULT, named, sampler_named, with_sampler
from harness.shader.source import ShaderSource

_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)


@dataclass(frozen=True)
class Tracer:
    """The path tracer with one strategy and one sampler (`harness.shader.samplers`).

    `library`: its GLSL; `shader`, `folder`: somebody's own path_tracer.frag, and a folder of files that stand in for
    the library's of the same name, read when the tracer is opened; `without`: features that are left out
    (`harness.scene.without`).
    """

    strategy: str = "mixture"
    library: Library = OURS
    shader: Path | None = None
    folder: Path | None = None
    without: tuple[str, ...] = ()
    sampler: str = DEFAULT

    @property
    def name(self) -> str:
        """The strategy's, and the sampler's where it is not the usual one: `mixture`, `mixture sobol`."""
        return named(self.strategy, self.sampler)

    def check(self, scene: SceneFile) -> str:
        """What light of the scene the strategy never finds; empty where it finds all.

        HarnessError for an unknown strategy or sampler, and where the scene has a depth set that somebody's shader
        would not heed."""
        sampler_named(self.sampler)
        if scene.max_depth is not None and (reason := self.takes_depth(scene)):
            raise HarnessError(reason)
        return check_strategy(load(scene), self.strategy).warning

    def takes_depth(self, scene: SceneFile) -> str:
        """Empty where the shader heeds MAX_DEPTH, which is written into it from the scene."""
        texts = [text for name, text in self.source(scene).files if name != GENERATED]
        if any(re.search(r"\bMAX_DEPTH\b", _COMMENT.sub(" ", text)) for text in texts):
            return ""
        return (f"{self.shader or self.folder or 'the shader'} does not use MAX_DEPTH, so no depth can be set; bound "
                "its paths by it")

    def whole_library(self) -> Library:
        """The library with one's own files and the sampler in it. HarnessError for files that cannot stand in for
        anything, for an unknown sampler, and for one that would stand in for one's own file."""
        own = self.shader is not None or self.folder is not None
        return with_sampler(own_library(self.shader, self.folder, self.library) if own else self.library, self.sampler)

    def source(self, scene: SceneFile) -> ShaderSource:
        """The shader that `open` compiles."""
        return self.source_of(self.reading(scene))

    def source_of(self, reading: Scene) -> ShaderSource:
        """The same, of what `reading` gave."""
        return self.whole_library().tracer(reading, self.strategy)

    def reading(self, scene: SceneFile) -> Scene:
        """What of the scene is drawn. SceneError for one outside our subset, HarnessError for an unknown strategy."""
        reading = load(scene)
        for feature in self.without:
            reading = FEATURES[feature](reading)
        check_strategy(reading, self.strategy)
        return reading

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[TracerRenderer]:
        """HarnessError for an unknown strategy or sampler, SceneError for a scene outside our subset, ShaderError for a
        shader that does not compile."""
        reading = self.reading(scene)
        with self.compiled(reading, self.source_of(reading)) as renderer:
            yield renderer

    @contextmanager
    def compiled(self, reading: Scene, source: ShaderSource) -> Iterator[TracerRenderer]:
        """The renderer of what `reading` and `source_of` gave, for who has them already. ShaderError for a shader that
        does not compile."""
        renderer = TracerRenderer(reading, self.strategy, source, sampler_named(self.sampler))
        try:
            yield renderer
        finally:
            renderer.release()
