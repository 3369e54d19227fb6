"""From a `Scene` to the Mitsuba scene of the very same file, with the film and sampler that a comparison needs."""

from __future__ import annotations

import dataclasses
from typing import Any

from harness.errors import HarnessError, SceneError
from harness.machine.mitsuba_runtime import REFERENCE_VARIANT, use_reference_variant
from harness.reference.expand import expand_shapes
from harness.reference.plugins import register_plugins
from harness.scene import Scene, load_scene, parse


def instantiate(scene: Scene) -> Any:
    """The `mi.Scene` of `scene`'s file: box filter, float32 RGB film of the scene's size, independent sampler.

    The file is parsed again by Mitsuba's parser. The sensor's film and sampler are replaced, so nothing that the
    harness adds to a film or integrator reaches Mitsuba, and what it adds to shapes is expanded (see `expand_shapes`).

    Raises HarnessError when the scene has no file; SceneError when the scene is not what its file says (but for film
    size and depth), and when Mitsuba refuses it.
    """
    if scene.path is None:
        raise HarnessError(f"scene '{scene.name}' has no file, so Mitsuba cannot render it; write it to an .xml file "
                           "and load it with harness.load_scene")
    _check_unchanged(scene)
    mi = use_reference_variant()
    register_plugins()
    state = parse(scene.path)
    expand_shapes(mi, state, scene)
    for node in state.nodes:
        if node.type == mi.ObjectType.Sensor:
            _equip(mi, node.props, scene)
        elif node.type == mi.ObjectType.Integrator and "strategies" in node.props:
            del node.props["strategies"]
        elif node.props.plugin_name() in ("bitmap", "envmap"):
            # Mitsuba looks in the process's folder too, before all others; the loader in the scene's alone.
            node.props["filename"] = str((scene.path.parent / node.props["filename"]).absolute())
    config = mi.parser.ParserConfig(REFERENCE_VARIANT)
    # Merging meshes of one BSDF refuses those whose flip_normals differ, which the scene format allows.
    config.merge_meshes = False
    try:
        mi.parser.transform_all(config, state)
        return mi.parser.instantiate(config, state)
    except Exception as error:  # Mitsuba raises bare RuntimeError, whose last line holds a Python plugin's message
        raise SceneError(f"{scene.path}: Mitsuba refuses the scene: {str(error).strip().splitlines()[-1]}") from None


def _equip(mi: Any, sensor: Any, scene: Scene) -> None:
    """Give the sensor's properties a film and a sampler in place of what the file nests in it."""
    for key in list(sensor.keys()):
        if isinstance(sensor[key], mi.Properties.Reference | mi.Properties.ResolvedReference):
            del sensor[key]
    # Mitsuba's defaults are a Gaussian filter, which correlates pixels, and a film of halves.
    sensor["film"] = mi.load_dict({
        "type": "hdrfilm", "width": scene.width, "height": scene.height, "pixel_format": "rgb",
        "component_format": "float32", "rfilter": {"type": "box"}})
    sensor["sampler"] = mi.load_dict({"type": "independent"})


def _check_unchanged(scene: Scene) -> None:
    """Only the film's size and the depth may differ from the file; all else Mitsuba takes from there."""
    assert scene.path is not None
    on_disk = load_scene(scene.path, width=scene.width, height=scene.height)
    if dataclasses.replace(on_disk, max_depth=scene.max_depth).content_hash != scene.content_hash:
        raise SceneError(f"{scene.path}: the scene differs from its file in more than film size and depth, and Mitsuba "
                         "renders the file; load it again, or write the change into the file")
