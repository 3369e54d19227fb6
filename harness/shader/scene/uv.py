"""GLSL for surface coordinates: (u, v) of the shapes whose textures look at them."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from harness.scene.model import Shape
from harness.shader.scene.literals import chosen, function, vector
from harness.shader.scene.rounding import to_object


def uv_include(users: Collection[int]) -> list[str]:
    """The library that `uv_function` calls."""
    return ['#include "lib/uv.glsl"'] if users else []


def uv_function(shapes: Sequence[Shape], users: Collection[int]) -> list[str]:
    """`surface_uv`: Mitsuba's surface coordinates of p on shape `id`, one of `users`; anything on the others."""
    ids = sorted(users)
    if not ids:
        return function("vec2 surface_uv(int id, vec3 p)", ["return vec2(0.0);"])
    inverses = {index: to_object(shapes[index]) for index in ids}
    body: list[str] = []
    for axis, name in enumerate("xyz"):
        body += chosen("vec4", f"row_{name}", {index: vector(inverses[index][axis]) for index in ids})
    body.append("vec3 q = vec3(dot(row_x.xyz, p) + row_x.w, dot(row_y.xyz, p) + row_y.w, dot(row_z.xyz, p) + row_z.w);")
    body += chosen("vec2", "uv", {index: f"uv_{shapes[index].kind}(q)" for index in ids})
    return function("vec2 surface_uv(int id, vec3 p)", [*body, "return uv;"])
