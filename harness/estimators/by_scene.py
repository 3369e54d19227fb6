"""What differs from scene to scene, or goes by another name: files named by the scene's parameters, and estimators that
somebody calls otherwise."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from string import Formatter
from typing import Literal

from harness.errors import HarnessError
from harness.estimators.base import Estimator, Renderer, no_depth, taken
from harness.estimators.images import Images
from harness.estimators.shader import RUN, Shader
from harness.scene.file import SceneFile

Kind = Literal["images", "shader"]


@dataclass(frozen=True)
class ByScene:
    """Images, or a shader, in files whose name may depend on the scene: `mine_{scene}_{alpha}_*.exr`.

    {scene} stands for the scene file's name without suffix, the name of a parameter for its value. `word` is otherwise
    what `Images.found` takes, or the path of a shader. `run`: frames of a shader's replica.
    """

    kind: Kind
    word: str
    run: int = RUN

    @property
    def name(self) -> str:
        """The word where it depends on the scene, else what is there is called."""
        return Path(self.word).name if self.depends else self._of({}).name

    @property
    def depends(self) -> tuple[str, ...]:
        """The names that stand in braces. HarnessError for braces that do not close."""
        try:
            return tuple(name for _, name, _, _ in Formatter().parse(self.word) if name is not None)
        except ValueError as error:
            raise HarnessError(f"--{self.kind} '{self.word}': {error}; write braces of its own twice, {{{{ and }}}}"
                               ) from None

    def check(self, scene: SceneFile) -> str:
        """They say nothing of the scene. HarnessError where there is no such file, for a name in braces that stands for
        nothing, and for a depth that was set."""
        found = self._at(scene)
        if scene.max_depth is not None:
            raise HarnessError(f"--{self.kind}: {no_depth(found, scene)}; leave out --max-depth")
        if isinstance(found, Images):
            with found.open(scene) as runs:
                if len(runs.files) < 2 and runs.traits.fixed is None:
                    raise HarnessError(f"{found.name}: one render without variance, from which nothing can be told of "
                                       "its noise; name several, each with a seed of its own: 'mine_*.exr'")
        return found.check(scene)

    def takes(self, scene: SceneFile) -> tuple[str, ...]:
        """The names in braces, and those of the shader."""
        return (*self.depends, *taken(self._at(scene), scene))

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[Renderer]:
        """As the images, or the shader, that the name means on this scene."""
        with self._at(scene).open(scene) as renderer:
            yield renderer

    def _at(self, scene: SceneFile) -> Images | Shader:
        values = {"scene": scene.path.stem, **scene.values}
        if unknown := next((name for name in self.depends if name not in values), None):
            allowed = ", ".join(f"{{{name}}}" for name in values)
            raise HarnessError(f"--{self.kind} '{self.word}': unknown '{{{unknown}}}'; allowed: {allowed}")
        return self._of(values)

    def _of(self, values: dict[str, str]) -> Images | Shader:
        word = self.word.format(**values)
        return Images.found(word) if self.kind == "images" else Shader((Path(word),), run=self.run)


@dataclass(frozen=True)
class Named:
    """An estimator under a name of somebody's choice."""

    estimator: Estimator
    name: str

    def check(self, scene: SceneFile) -> str:
        """The estimator's."""
        return self.estimator.check(scene)

    def takes_depth(self, scene: SceneFile) -> str:
        """The estimator's."""
        return no_depth(self.estimator, scene)

    def takes(self, scene: SceneFile) -> tuple[str, ...]:
        """The estimator's."""
        return taken(self.estimator, scene)

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[Renderer]:
        """The estimator's."""
        with self.estimator.open(scene) as renderer:
            yield renderer


def named(text: str, make: Callable[[str], Estimator]) -> Estimator:
    """`NAME=REST` as what `make` makes of the rest, called NAME; the whole as it is where no name stands before it, as
    in `./a=b.exr`."""
    found = re.fullmatch(r"([A-Za-z][\w.+-]*)=(.+)", text, re.DOTALL)
    return Named(make(found[2]), found[1].strip()) if found else make(text)
