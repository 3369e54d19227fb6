"""GLSL for the light from infinity."""

from __future__ import annotations

import numpy as np

from harness.scene.model import RGB, EnvironmentMap
from harness.shader.scene.literals import function, in_comment, number, vector

# The sampler that holds an environment map.
SAMPLER = "environment_map"


def environment_function(environment: RGB | EnvironmentMap) -> list[str]:
    """`environment`: the radiance that arrives from direction d, towards the light."""
    if isinstance(environment, tuple):
        return function("vec3 environment(vec3 d)", [f"return {vector(environment)};"])
    # Columns of the inverse, which is the transpose: a rotation.
    columns = np.array(environment.to_world)[:3, :3]
    turned = "d" if np.array_equal(columns, np.eye(3)) else f"mat3({', '.join(map(vector, columns))}) * d"
    scaled = "" if environment.scale == 1 else f" * {number(environment.scale)}"
    return [
        '#include "lib/environment.glsl"',
        "",
        f"// {in_comment(environment.path.name)}, linear, first row first; filter linear, wrap: repeat in s, clamp to "
        "edge in t, no mipmaps.",
        f"uniform sampler2D {SAMPLER};",
        "",
        *function("vec3 environment(vec3 d)",
                  [f"return environment_texel({SAMPLER}, {number(environment.rows)}, {turned}){scaled};"]),
    ]
