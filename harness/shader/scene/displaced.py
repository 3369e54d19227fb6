"""GLSL for displaced spheres: their places, bounds and surfaces, which all of a scene's share one marching loop for."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from harness.scene.displaced import Bounds, bounds
from harness.scene.model import Displacement, Procedural, Shape
from harness.scene.procedural import KINDS
from harness.shader.scene.literals import chosen, function, is_any, number, vector
from harness.shader.scene.motion import Motions
from harness.shader.scene.procedural import evaluation, ramp

# Steps that a ray may take, at most: of 10^6 rays past a sphere none took more than 56 where `bend` is 93, 96 where it
# is 455, 120 where it is 1800; up to 240 past the axis of wood's rings. A ray that is not through by then counts as met
# where it is, which is close to the surface.
LEAST_STEPS, STEPS_PER_ROOT_BEND = 32, 4.0


def displaced(shapes: Sequence[Shape]) -> list[tuple[int, Shape]]:
    """The displaced spheres of a scene with their ids."""
    return [(index, shape) for index, shape in enumerate(shapes) if shape.kind == "displacedsphere"]


def march_steps(shapes: Sequence[Shape]) -> int:
    """Iterations that displaced spheres add to those of one ray, at most."""
    steps = [_steps(bounds(_displacement(shape))) for _, shape in displaced(shapes)]
    return max(steps, default=0) + (max(steps) if len(steps) > 1 else 0)


def march_declarations(shapes: Sequence[Shape], motions: Motions) -> list[str]:
    """The functions that lib/displaced.glsl expects, and the library; nothing where no sphere is displaced."""
    spheres = displaced(shapes)
    if not spheres:
        return []
    limits = [bounds(_displacement(shape)) for _, shape in spheres]
    return [f"#define DISPLACED_SPHERES {len(spheres)}", f"#define MAX_MARCH_STEPS {march_steps(shapes)}",
            f"#define HAS_CORNERS {int(any(b.least < b.greatest for b in limits))}",
            f"#define HAS_RINGS {int(any(b.axis_bend > 0 for b in limits))}",
            '#include "lib/procedural.glsl"', '#include "lib/displaced.glsl"', "",
            *_sphere_function(spheres), *_shell_function(spheres, motions), *_ray_function(spheres, motions),
            *_relief_function(spheres)]


def march_normal(shapes: Sequence[Shape]) -> list[str]:
    """Statements of `surface_normal` that set `n` where shape `id` is a displaced sphere."""
    sides: dict[str, list[int]] = {}
    for index, shape in displaced(shapes):
        sides.setdefault("-displaced_normal" if shape.flip_normals else "displaced_normal", []).append(index)
    return [f"if ({is_any(ids)}) n = {value};" for value, ids in sides.items()]


def place(shape: Shape) -> tuple[np.ndarray, float]:
    """Centre, (3,), and radius, undisplaced, in world space."""
    return shape.matrix[:3, 3], float(np.cbrt(abs(np.linalg.det(shape.matrix[:3, :3]))))


def _sphere_function(spheres: Sequence[tuple[int, Shape]]) -> list[str]:
    values = {}
    for index, shape in spheres:
        center, radius = place(shape)
        b = bounds(_displacement(shape))
        numbers = (radius, b.lowest, b.highest, b.slope, b.bend, b.axis_bend)
        values[index] = f"DisplacedSphere({vector(center)}, {', '.join(map(number, numbers))})"
    body = chosen("DisplacedSphere", "value", values)
    return function("DisplacedSphere displaced_sphere(int id)", [*body, "return value;"])


def _shell_function(spheres: Sequence[tuple[int, Shape]], motions: Motions) -> list[str]:
    body = ["int id = -1;", "uint taken = 0u;", "float nearest = reach;", "float s;", *_rays(spheres, motions)]
    for ordinal, (index, shape) in enumerate(spheres):
        center, radius = place(shape)
        highest = radius * bounds(_displacement(shape)).highest
        bit = f"{1 << ordinal}u"
        body += [f"s = (left & {bit}) != 0u ? enter_shell({motions.ray(index)}, {vector(center)}, {number(highest)})"
                 " : NO_HIT;",
                 f"if (s >= reach) left &= ~{bit};",
                 f"if (s < nearest) {{ nearest = s; id = {index}; taken = {bit}; }}"]
    return ["// The displaced sphere whose shell the ray enters first of those whose bits are in `left`, or -1. Its",
            "// bit leaves `left`, and so do those of spheres that the ray does not enter within `reach`.",
            *function("int nearest_shell(vec3 o, vec3 d, float reach, inout uint left)",
                      [*body, "left &= ~taken;", "return id;"])]


def _ray_function(spheres: Sequence[tuple[int, Shape]], motions: Motions) -> list[str]:
    """`carry_ray`: into the frame in which displaced sphere `id` rests."""
    body = _rays(spheres, motions)
    for index, _ in spheres:
        if (ray := motions.ray(index)) != "o, d":
            origin, direction = ray.split(", ")
            body.append(f"if (id == {index}) {{ o = {origin}; d = {direction}; }}")
    return function("void carry_ray(int id, inout vec3 o, inout vec3 d)", body)


def _rays(spheres: Sequence[tuple[int, Shape]], motions: Motions) -> list[str]:
    return motions.rays() if any(motions.ray(index) != "o, d" for index, _ in spheres) else []


def _steps(b: Bounds) -> int:
    return round((LEAST_STEPS + STEPS_PER_ROOT_BEND * math.sqrt(b.bend)) * (2 if b.axis_bend else 1))


def _relief_function(spheres: Sequence[tuple[int, Shape]]) -> list[str]:
    textures = {index: _texture(shape) for index, shape in spheres}
    to_texture = {index: _to_texture(shape) for index, shape in spheres}
    body, back = _coordinates(to_texture)
    body += [*evaluation(textures, gradient=True), "vec3 gradient = value.xyz;", "float t = value.w;"]
    body += _ramp({index: (texture, _displacement(shape).amplitude)
                   for (index, shape), texture in zip(spheres, textures.values(), strict=True)})
    per_scale = {index: number(1 / float(np.linalg.norm(to_texture[index][:, :3], ord=2)))
                 for index, texture in textures.items() if KINDS[texture.kind].rings}
    body.append("float axis = FAR;")
    body += [f"if ({is_any([index])}) axis = wood_radius(q) * {value};" for index, value in per_scale.items()]
    return function("Relief relief(int id, vec3 direction)",
                    [*body, f"return Relief(r, slope, least, greatest, room, {back}, axis);"])


def _coordinates(to_texture: dict[int, np.ndarray]) -> tuple[list[str], str]:
    """Statements that declare `q`, the direction in noise cells, and the expression of the gradient along it."""
    lines = chosen("vec3", "offset", {index: vector(matrix[:, 3]) for index, matrix in to_texture.items()})
    if all(np.allclose(m[:, :3], m[0, 0] * np.eye(3), rtol=0, atol=1e-9 * abs(m[0, 0])) for m in to_texture.values()):
        lines += chosen("float", "scale", {index: number(matrix[0, 0]) for index, matrix in to_texture.items()})
        return [*lines, "vec3 q = scale * direction + offset;"], "scale * gradient"
    lines += chosen("mat3", "axes", {index: f"mat3({', '.join(map(vector, matrix[:, :3].T))})"
                                     for index, matrix in to_texture.items()})
    return [*lines, "vec3 q = axes * direction + offset;"], "gradient * axes"


def _ramp(textures: dict[int, tuple[Procedural, float]]) -> list[str]:
    """Statements that declare `r`, the ramp's `slope` at t, its `least` and `greatest`, and `room` up to a corner."""
    radii, slopes, least, greatest, room = {}, {}, {}, {}, {}
    for index, (texture, amplitude) in textures.items():
        stops = amplitude * np.array([color[0] for color in texture.colors])
        last = len(stops) - 1
        steps = np.diff(stops) * last
        radii[index] = ramp("t", 1 + stops, number)
        slopes[index] = " : ".join([*(f"t < {number((step + 1) / last)} ? {number(steps[step])}"
                                      for step in range(last - 1)), number(steps[-1])])
        room[index] = "FAR" if last == 1 else f"ramp_room(t, {number(last)})"
        least[index], greatest[index] = number(steps.min()), number(steps.max())
    return [*chosen("float", "r", radii), *chosen("float", "slope", slopes), *chosen("float", "least", least),
            *chosen("float", "greatest", greatest), *chosen("float", "room", room)]


def _displacement(shape: Shape) -> Displacement:
    assert shape.displacement is not None
    return shape.displacement


def _texture(shape: Shape) -> Procedural:
    texture = _displacement(shape).texture
    assert isinstance(texture, Procedural)
    return texture


def _to_texture(shape: Shape) -> np.ndarray:
    """From unit directions of world space to cells of the noise: (3, 4), linear part and offset."""
    _, radius = place(shape)
    matrix = np.array(_texture(shape).to_texture) * _texture(shape).frequency
    linear = matrix[:3, :3] @ np.linalg.inv(shape.matrix[:3, :3]) * radius
    return np.column_stack([linear, matrix[:3, 3]])
