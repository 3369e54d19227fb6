"""Light from infinity in a scene file: one radiance for all directions, or a map of them."""

from __future__ import annotations

from harness.scene.bitmaps import load_environment_map
from harness.scene.model import RGB, EnvironmentMap
from harness.scene.nodes import Node


def load_environment(node: Node) -> RGB | EnvironmentMap:
    """A `constant` or an `envmap` emitter."""
    if node.plugin == "envmap":
        return load_environment_map(node)
    if node.plugin != "constant":
        raise node.refuse(["constant, envmap (in the scene)", "area (inside a shape)"])
    radiance = node.rgb("radiance", 1.0, emission=True)
    node.done(["radiance"])
    return radiance
