"""GLSL for the light from infinity."""

from __future__ import annotations

import re

import numpy as np

from harness.scene.importance import sampling_table, texel_density
from harness.scene.model import RGB, EnvironmentMap
from harness.shader.scene.literals import function, in_comment, number, vector

# The sampler that holds an environment map, and those by whose table directions are drawn from it, of which a shader
# has one: for all of its light, or compensated for what else draws directions.
SAMPLER = "environment_map"
TABLE, COMPENSATED_TABLE = "environment_table", "compensated_environment_table"


def environment_function(environment: RGB | EnvironmentMap) -> list[str]:
    """`environment`: the radiance that arrives from direction d, towards the light."""
    if isinstance(environment, tuple):
        return function("vec3 environment(vec3 d)", [f"return {vector(environment)};"])
    scaled = "" if environment.scale == 1 else f" * {number(environment.scale)}"
    return [
        '#include "lib/environment.glsl"',
        "",
        f"// {in_comment(environment.path.name)}, linear, first row first; filter linear, wrap: repeat in s, clamp to "
        "edge in t, no mipmaps.",
        f"uniform sampler2D {SAMPLER};",
        "",
        *function("vec3 environment(vec3 d)", [f"return {_texel(environment)}.rgb{scaled};"]),
    ]


def sampling_functions(environment: EnvironmentMap, *, compensated: bool = False) -> list[str]:
    """`sample_environment` and `pdf_environment`, to stand behind `environment`: a direction drawn from the map.

    The pdf is the alpha of the texel that `environment` reads, and costs nothing beside it. `compensated`: only what
    is brighter than the mean is drawn, so the pdf is zero for much of the light, which the BSDF has to find.
    HarnessError for a black map, SceneError where its file changed: see `harness.scene.importance`.
    """
    rows, columns = texel_density(environment, compensated=compensated).shape
    table_rows, table_columns = sampling_table(environment, compensated=compensated).shape[:2]
    rotation = np.array(environment.to_world)[:3, :3]
    name = COMPENSATED_TABLE if compensated else TABLE
    drawn = f"sample_environment_texel({name}, {vector((columns, rows, table_columns, table_rows))}, pick, u)"
    return [
        f"// By which directions are drawn from {in_comment(environment.path.name)}, whose alpha is then their pdf; "
        "filter nearest.",
        f"uniform sampler2D {name};",
        "",
        "// Per steradian, for any unit direction d.",
        *function("float pdf_environment(vec3 d)", [f"return {_texel(environment)}.a;"]),
        "// A unit direction towards the light from infinity, and its pdf; pick and u are uniform.",
        *function("vec3 sample_environment(float pick, vec2 u, out float pdf)",
                  [f"vec3 d = {_turned(rotation.T, drawn)};", "pdf = pdf_environment(d);", "return d;"]),
    ]


def drawn_by(text: str) -> str | None:
    """The table by which a shader draws directions from its environment map; None where it draws none."""
    return next((name for name in (COMPENSATED_TABLE, TABLE) if re.search(rf"\b{name}\b", text)), None)


def _texel(environment: EnvironmentMap) -> str:
    """The texel of direction d of the scene."""
    return (f"environment_texel({SAMPLER}, {number(environment.rows)}, "
            f"{_turned(np.array(environment.to_world)[:3, :3], 'd')})")


def _turned(columns: np.ndarray, d: str) -> str:
    """A direction under the rotation that has these columns, as rows of an array: the transpose is the inverse."""
    return d if np.array_equal(columns, np.eye(3)) else f"mat3({', '.join(map(vector, columns))}) * {d}"
