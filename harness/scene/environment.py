"""Light from infinity in a scene file: one radiance for all directions."""

from __future__ import annotations

from harness.scene.model import RGB, EnvironmentMap
from harness.scene.nodes import Node


def load_environment(node: Node) -> RGB | EnvironmentMap:
    """A `constant` emitter."""
    if node.plugin != "constant":
        raise node.refuse(["constant (in the scene)", "area (inside a shape)"])
    radiance = node.rgb("radiance", 1.0, emission=True)
    node.done(["radiance"])
    return radiance
