"""From a Mitsuba scene file to a `Scene`: Mitsuba parses, this module understands the subset and refuses the rest."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from harness.errors import SceneError
from harness.scene.environment import load_environment
from harness.scene.file import MAX_DEPTH_LIMIT, SceneFile
from harness.scene.materials import load_material
from harness.scene.model import RGB, EnvironmentMap, Scene, Shape
from harness.scene.nodes import Node
from harness.scene.sensors import Sensor, load_sensor
from harness.scene.shapes import load_shape
from harness.scene.textures import load_varying


def load(file: SceneFile) -> Scene:
    """Our reading of a scene file. SceneError as `load_scene`."""
    width, height = file.size or (None, None)
    return load_scene(file.path, width=width, height=height, parameters=dict(file.parameters), max_depth=file.max_depth)


def load_scene(path: str | Path, *, width: int | None = None, height: int | None = None,
               parameters: Mapping[str, str] | None = None, max_depth: int | None = None) -> Scene:
    """Read a Mitsuba 3 XML scene into a `Scene`; `width` and `height` (pixels) override the film's, `parameters` the
    file's `<default>` values, `max_depth` the integrator's.

    Raises SceneError (one line with file and line) for anything malformed or outside the supported subset.
    """
    path = Path(path)
    given = tuple(sorted((parameters or {}).items()))
    file = SceneFile(path, given, max_depth=max_depth)
    state = file.parsed()
    root = Node(state, 0)
    if root.kind != "scene":
        raise root.error(f"the root element must be <scene>, found a {root.kind}")
    shapes: list[Shape] = []
    environment: RGB | EnvironmentMap | None = None
    sensor: Sensor | None = None
    depth: int | None = None
    for _, node in root.children():
        match node.kind:
            case "shape":
                shapes.append(load_shape(node))
            case "emitter":
                if environment is not None:
                    raise node.error("a scene has one environment; this is the second")
                environment = load_environment(node)
            case "sensor":
                if sensor is not None:
                    raise node.error("a scene has one sensor; this is the second")
                sensor = load_sensor(node, width, height)
            case "integrator":
                if depth is not None:
                    raise node.error("a scene has one integrator; this is the second")
                depth = _integrator(node)
            case "bsdf":
                load_material(node)  # used by reference; checked here, so that an unused one is not silently wrong
            case "texture":
                load_varying(node)
            case _:
                raise node.refuse(["shape", "emitter constant", "sensor", "integrator", "bsdf", "texture"])
    root.done([])
    if sensor is None:
        raise root.error("the scene has no <sensor>; add one of type 'perspective'")
    if depth is None:
        raise root.error("the scene has no <integrator>; add one of type 'path' with 'max_depth'")
    return Scene(tuple(shapes), environment or (0.0, 0.0, 0.0), sensor.camera, sensor.width, sensor.height,
                 depth, name=file.name, path=path.resolve(), parameters=given, depth_given=max_depth)


def file_of(scene: Scene) -> SceneFile:
    """What a scene is a reading of. HarnessError where it has no file, SceneError where it was changed in memory in
    more than film size: whoever opens the file would render something else."""
    file = scene.file
    if load(file).content_hash != scene.content_hash:
        raise SceneError(f"{file.path}: the scene differs from its file in more than film size, and the file is what "
                         "is rendered; load it again, or write the change into the file")
    return file


def describe(path: str | Path) -> str:
    """The scene file's opening comment as one paragraph; empty where there is none."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError:
        raise SceneError(f"{path}: not UTF-8 text; save the file in the encoding UTF-8") from None
    found = re.match(r"\s*(?:<\?xml.*?\?>)?\s*<!--(.*?)-->", text, re.DOTALL)
    return " ".join(found[1].split()) if found else ""


def _integrator(node: Node) -> int:
    """Its `max_depth`."""
    if node.plugin != "path":
        raise node.refuse(["path"])
    max_depth = node.integer("max_depth", -1)
    if not 1 <= max_depth <= MAX_DEPTH_LIMIT:
        raise node.error(f"'max_depth' must be between 1 and {MAX_DEPTH_LIMIT}, found {max_depth}"
                         f"{' (unbounded)' if max_depth == -1 else ''}; both renderers trace bounded paths")
    if node.boolean("hide_emitters", False):
        raise node.error("'hide_emitters' must be false; supported: max_depth, rr_depth")
    node.ignore("rr_depth")  # Russian roulette is off in both renderers; it changes the noise, not the mean
    node.ignore("strategies")  # a matter of presentation
    node.done(["max_depth", "rr_depth", "strategies"])
    return max_depth
