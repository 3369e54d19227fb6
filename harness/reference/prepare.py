"""From a scene file to the Mitsuba scene of the very same file, with the film and sampler that a comparison needs."""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.errors import SceneError
from harness.machine.mitsuba_runtime import REFERENCE_VARIANT, use_reference_variant
from harness.reference.expand import expand_shapes, move_to_frame
from harness.reference.offsets import offset_seen
from harness.reference.plugins import register_plugins
from harness.scene import Film, Scene, SceneFile, load
from harness.scene.frame import LARGEST_OFFSET, Frame, frame_of, framed
from harness.scene.procedural import KINDS

_log = logging.getLogger(__name__)

# What only the harness has words for: shapes and textures that must be expanded with our reading of the scene at hand.
OUR_PLUGINS = ("displacedsphere", *KINDS)
OUR_PROPERTIES = ("motion",)
# The sampler whose samples are independent of each other, as all that is said of their noise supposes.
INDEPENDENT = "independent"
# In what Mitsuba says: where in its own source it arose, and where in the scene.
_SOURCE = re.compile(r"\[[\w.]+:\d+\] ")
_PLACE = re.compile(r"At (?P<file>.+?) \(line (?P<line>\d+), col \d+\): ")


@dataclass(frozen=True, eq=False)
class Prepared:
    """A scene that Mitsuba can render: `scene` is its `mi.Scene`.

    `reading`: ours of the same file, None where it holds what our tracer has no words for. `integrator`, `max_depth`:
    what the file says, the latter None where it leaves paths unbounded.
    """

    scene: Any
    film: Film
    reading: Scene | None
    integrator: str
    max_depth: int | None


def prepare(file: SceneFile, variant: str = REFERENCE_VARIANT, sampler: str = INDEPENDENT) -> Prepared:
    """Any Mitsuba scene: box filter, float32 RGB film of the file's size, `sampler`; the rest as it stands.

    The sensor's film and sampler are replaced, so nothing that the harness adds to a film or integrator reaches
    Mitsuba, and what it adds to shapes is expanded (see `expand_shapes`).

    Raises SceneError where the scene has no sensor, where words of ours stand beside what our tracer does not
    understand (they can only be expanded together), and where Mitsuba refuses the scene.
    """
    mi = use_reference_variant(variant)
    register_plugins()
    film, state = file.film, file.parsed()
    reading = _reading(mi, file, state)
    if reading is not None:
        _warn_of_offset(file, frame_of(reading))
        move_to_frame(mi, state, reading)
        reading = framed(reading)
        expand_shapes(mi, state, reading)
    integrator, max_depth = "path", None
    for node in state.nodes:
        if node.type == mi.ObjectType.Sensor:
            _equip(mi, node.props, state, film, sampler)
        elif node.type == mi.ObjectType.Integrator:
            integrator = str(node.props.plugin_name())
            depth = node.props.get("max_depth", -1)
            max_depth = int(depth) if isinstance(depth, int) and depth > 0 else None
            if "strategies" in node.props:
                del node.props["strategies"]
        if isinstance(node.props.get("filename", None), str):
            # Mitsuba looks in the process's folder too, before all others; the loader in the scene's alone.
            named = file.path.parent / node.props["filename"]
            if named.is_file():
                node.props["filename"] = str(named.absolute())
    config = mi.parser.ParserConfig(variant)
    # Merging meshes of one BSDF refuses those whose flip_normals differ, which the scene format allows.
    config.merge_meshes = False
    try:
        mi.parser.transform_all(config, state)
        scene = mi.parser.instantiate(config, state)
    except Exception as error:  # Mitsuba raises bare RuntimeError, whose last line holds a Python plugin's message
        raise SceneError(_refusal(file, str(error))) from None
    if reading is None and (offset := offset_seen(mi, scene)) > LARGEST_OFFSET:
        _log.warning("%s: Mitsuba lifts rays off surfaces by %.1e of the width of what is seen, so that light passes "
                     "under what stands on a floor: its image is not exact; scale and shift the scene until what is "
                     "seen is some units wide and near the origin", file.path, offset)
    return Prepared(scene, film, reading, integrator, max_depth)


def instantiate(file: SceneFile) -> Any:
    """The `mi.Scene` alone; see `prepare`."""
    return prepare(file).scene


def _warn_of_offset(file: SceneFile, frame: Frame) -> None:
    """Where no frame keeps Mitsuba's offset small beside what is seen and large beside what float32 rounds."""
    if frame.offset > LARGEST_OFFSET:
        _log.warning("%s: Mitsuba lifts rays off surfaces by %.1e of the width of what is seen, and may lose light on "
                     "a sphere or cylinder so much larger than that: its image is not exact; use a smaller radius",
                     file.path, frame.offset)


def _refusal(file: SceneFile, message: str) -> str:
    """What Mitsuba says of a scene, with file and line where it tells them."""
    text = reason(message)
    found = _PLACE.search(text)
    where = f"{found['file']}:{found['line']}" if found else str(file.path)
    return f"{where}: Mitsuba refuses the scene: {_PLACE.sub('', text)}"


def reason(message: str) -> str:
    """The last line of a message of Mitsuba's, without the places in its own source."""
    return _SOURCE.sub("", message.strip().splitlines()[-1])


def _reading(mi: Any, file: SceneFile, state: Any) -> Scene | None:
    """Our reading, needed where there are words of ours, and wherever it can be had: it knows what Mitsuba does wrong
    (textured lights, see `harness.reference.lights`)."""
    try:
        return load(file)
    except SceneError:
        ours = any(node.props.plugin_name() in OUR_PLUGINS or any(name in node.props for name in OUR_PROPERTIES)
                   for node in state.nodes)
        if ours or not Path(file.path).is_file():
            raise
        return None


def _equip(mi: Any, sensor: Any, state: Any, film: Film, sampler: str) -> None:
    """Give the sensor's properties a film and a sampler in place of what the file nests in it."""
    for key in list(sensor.keys()):
        value = sensor[key]
        if isinstance(value, mi.Properties.Reference):
            kind = state.nodes[state.id_to_index[value.id()]].type
        elif isinstance(value, mi.Properties.ResolvedReference):
            kind = state.nodes[value.index()].type
        else:
            continue
        if kind in (mi.ObjectType.Film, mi.ObjectType.Sampler):
            del sensor[key]
    # Mitsuba's defaults are a Gaussian filter, which correlates pixels, and a film of halves.
    sensor["film"] = mi.load_dict({
        "type": "hdrfilm", "width": film.width, "height": film.height, "pixel_format": "rgb",
        "component_format": "float32", "rfilter": {"type": "box"}})
    sensor["sampler"] = mi.load_dict({"type": sampler})
