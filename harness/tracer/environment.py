"""GLSL for the light from infinity."""

from __future__ import annotations

from harness.scene.model import RGB, EnvironmentMap
from harness.tracer.literals import function, vector


def environment_function(environment: RGB | EnvironmentMap) -> list[str]:
    """`environment`: the radiance that arrives from direction d, towards the light."""
    assert isinstance(environment, tuple)
    return function("vec3 environment(vec3 d)", [f"return {vector(environment)};"])
