"""What is rendered: a scene file with its parameters and film size, apart from anybody's reading of it."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from harness.errors import HarnessError
from harness.files import data_dir
from harness.scene.nodes import Node, parse

# A path longer than this is refused: the tracer's loop is bounded (see gpu.pingpong).
MAX_DEPTH_LIMIT = 1024
# Mitsuba's integrators that have a `max_depth` (its documentation, "Integrators"), and ours.
WITH_DEPTH = ("path", "bsdf_path", "volpath", "volpathmis", "ptracer", "prb", "prb_basic", "prbvolpath")
# Mitsuba's `hdrfilm` where a file does not say (its documentation, "High dynamic range film").
DEFAULT_FILM = (768, 576)


@dataclass(frozen=True)
class Film:
    """The film of a scene file: pixels, and the exposure (stops) at which display metrics see its images."""

    width: int
    height: int
    exposure: float = 0.0


@dataclass(frozen=True)
class SceneFile:
    """A Mitsuba 3 scene file, the values of its `<default>` parameters, and film size and path length if not its own.

    `parameters`: pairs of name and value, sorted by name, as Mitsuba's parser takes them (`$name` in the file).
    `size`: (width, height). `max_depth`: vertices of a path at most, counted as Mitsuba's `path` does (1: light seen
    directly, N: N-1 scatterings); HarnessError outside 1 to 1024. `besides`: pairs of names that the file does not
    declare and their values, sorted by name: they are no part of the scene, but of what a study sets, for estimators
    that know the name (a shader's uniform, a word of a command line). Mitsuba renders any of them; our tracer reads it
    into a `Scene`, and may refuse.
    """

    path: Path
    parameters: tuple[tuple[str, str], ...] = ()
    size: tuple[int, int] | None = None
    max_depth: int | None = None
    besides: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        if self.max_depth is not None and not 1 <= self.max_depth <= MAX_DEPTH_LIMIT:
            raise HarnessError(f"max_depth is {self.max_depth}; allowed: 1 (light seen directly) to {MAX_DEPTH_LIMIT}")
        object.__setattr__(self, "path", Path(self.path))
        object.__setattr__(self, "parameters", tuple(sorted(self.parameters)))
        object.__setattr__(self, "besides", tuple(sorted(self.besides)))

    @classmethod
    def bundled(cls, name: str, size: tuple[int, int] | None = None) -> SceneFile:
        """A scene that comes with the harness, `spheres` or `exhibits/tangent`; HarnessError for an unknown name."""
        folder = data_dir("mitsuba_scenes")
        path = folder / f"{name}.xml"
        if not path.is_file():
            known = ", ".join(sorted(file.stem for file in folder.glob("*.xml")))
            raise HarnessError(f"unknown scene '{name}'; name an .xml file, or one of {known}")
        return cls(path, size=size)

    @property
    def name(self) -> str:
        """The file's name without its suffix, with what was set: `plates alpha=10 max_depth=2`."""
        return " ".join([self.path.stem, *(f"{name}={value}" for name, value in self.given)])

    @property
    def given(self) -> tuple[tuple[str, str], ...]:
        """What was set by name, in the scene, besides it, and the depth, as (name, value)."""
        values = tuple(self.values.items())
        return values if self.max_depth is None else (*values, ("max_depth", str(self.max_depth)))

    @property
    def values(self) -> dict[str, str]:
        """What was set by name, in the scene and besides it, sorted by name."""
        return dict(sorted((*self.parameters, *self.besides)))

    def sized(self, width: int, height: int) -> SceneFile:
        """The same with another film size."""
        return replace(self, size=(width, height))

    def at_depth(self, max_depth: int) -> SceneFile:
        """The same with paths of so many vertices at most."""
        return replace(self, max_depth=max_depth)

    def parsed(self) -> Any:
        """A fresh `mi.parser.ParserState`, with `max_depth` in its integrator if one is set. SceneError where the file
        is missing, Mitsuba's parser refuses it, or its integrator knows no depth."""
        state = parse(self.path, self.parameters)
        if self.max_depth is not None:
            node = _integrator(state)
            if node.plugin not in WITH_DEPTH:
                raise node.error(f"integrator '{node.plugin}' has no max_depth to set; those that have: "
                                 f"{', '.join(WITH_DEPTH)}")
            node.properties["max_depth"] = self.max_depth
        return state

    @property
    def depth(self) -> int | None:
        """Vertices of a path at most: `max_depth`, or what the file says; None where it sets no bound.

        SceneError as `parsed`, and where the file has no integrator."""
        found = _integrator(self.parsed()).properties.get("max_depth", -1)
        return int(found) if isinstance(found, int) and found > 0 else None

    @property
    def hash(self) -> str:
        """16 hexadecimal digits over the bytes of all that is read for an image (the file, its includes, the files
        that it names), the parameters, the size and the depth. SceneError as `parsed`."""
        depth = [] if self.max_depth is None else [self.max_depth]
        whole = hashlib.sha256(json.dumps([self.parameters, self.size, *depth]).encode())
        for path in self.sources:
            whole.update(hashlib.sha256(path.read_bytes()).digest())
        return whole.hexdigest()[:16]

    @property
    def sources(self) -> tuple[Path, ...]:
        """All that is read for an image: the file, its includes, the files that it names. SceneError as `parsed`."""
        state = self.parsed()
        return (*(Path(str(file)) for file in state.files), *self._named(state))

    @property
    def film(self) -> Film:
        """The first sensor's film, at the size asked for. SceneError where there is no sensor."""
        state = self.parsed()
        root = Node(state, 0)
        sensor = next((node for _, node in root.children() if node.kind == "sensor"), None)
        if sensor is None:
            raise root.error("the scene has no <sensor>; add one of type 'perspective'")
        film = next((node for _, node in sensor.children() if node.kind == "film"), None)
        props = film.properties if film else {}
        found = [int(props["width"]) if "width" in props else DEFAULT_FILM[0],
                 int(props["height"]) if "height" in props else DEFAULT_FILM[1]]
        for axis, key in enumerate(("crop_width", "crop_height")):
            found[axis] = int(props[key]) if key in props else found[axis]
        exposure = float(props["exposure"]) if "exposure" in props else 0.0
        width, height = self.size or (found[0], found[1])
        return Film(width, height, exposure)

    def _named(self, state: Any) -> list[Path]:
        """The files that properties of the scene name, such as textures and meshes."""
        named: set[Path] = set()
        for node in state.nodes:
            folders = {self.path.parent, Path(str(state.files[node.file_index])).parent}
            texts = [value for key in node.props.keys() if isinstance(value := node.props[key], str) and value]
            named |= {folder / text for folder in folders for text in texts if (folder / text).is_file()}
        return sorted(named)


def _integrator(state: Any) -> Node:
    """The scene's integrator. SceneError where there is none."""
    root = Node(state, 0)
    found = next((node for _, node in root.children() if node.kind == "integrator"), None)
    if found is None:
        raise root.error("the scene has no <integrator>; add one of type 'path' with 'max_depth'")
    return found
