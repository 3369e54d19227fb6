"""GLSL for displaced spheres: their places, bounds and surfaces, which all of a scene's share one marching loop for."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from harness.scene.displaced import Bounds, bounds
from harness.scene.model import Displacement, Procedural, Shape
from harness.scene.noise import OCTAVE, UINT32, UNIT
from harness.scene.procedural import RISE, WOOD_GRAIN
from harness.shader.scene.literals import chosen, function, is_any, number, vector
from harness.shader.scene.motion import Motions

# Steps that a ray may take, at most: of 10^6 rays past a sphere none took more than 56 where `bend` is 93, 96 where it
# is 455, 120 where it is 1800; up to 240 past the axis of wood's rings. A ray that is not through by then counts as met
# where it is, which is close to the surface.
LEAST_STEPS, STEPS_PER_ROOT_BEND = 32, 4.0
# The way to an axis, or a corner of the ramp, where there is none: no limit to any step.
FAR = 1e30


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
    body += _noise(textures)
    waves = {index: texture for index, texture in textures.items() if texture.kind != "fractal"}
    body += ["vec3 gradient = noise.xyz;", "float t = noise.w;"]
    if waves:
        body += _wave(waves, everywhere=len(waves) == len(textures))
    body += _ramp({index: (texture, _displacement(shape).amplitude)
                   for (index, shape), texture in zip(spheres, textures.values(), strict=True)})
    woods = [index for index, texture in textures.items() if texture.kind == "wood"]
    per_scale = {index: number(1 / float(np.linalg.norm(to_texture[index][:, :3], ord=2))) for index in woods}
    body.append(f"float axis = {number(FAR)};")
    body += [f"if ({is_any([index])}) axis = length(q.xy) * {value};" for index, value in per_scale.items()]
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


def _noise(textures: dict[int, Procedural]) -> list[str]:
    """Statements that declare `noise`: fbm at q, xyz its gradient along the cells' axes and w its value."""
    lines = chosen("vec3", "cell", {index: f"q * {vector(WOOD_GRAIN)}" if texture.kind == "wood" else "q"
                                    for index, texture in textures.items()})
    lines += chosen("uint", "seed", {index: f"{texture.seed}u" for index, texture in textures.items()})
    lines += chosen("float", "lacunarity", {index: number(texture.lacunarity) for index, texture in textures.items()})
    lines.append("vec4 noise = vec4(0.0);")
    for octave in range(max(texture.octaves for texture in textures.values())):
        weights = {index: _weights(texture, octave) for index, texture in textures.items()}
        lines += chosen("vec4", f"weight_{octave}", weights)
        if octave:
            lines.append("cell *= lacunarity;")
        lines.append(f"noise += weight_{octave} * cell_noise_gradient(cell, seed + {octave * OCTAVE & UINT32}u);")
    return lines


def _weights(texture: Procedural, octave: int) -> str:
    """What an octave's gradient and value, in steps of 2^-24, count for; nothing beyond the texture's own octaves."""
    if octave >= texture.octaves:
        return "vec4(0.0)"
    weight = UNIT * texture.gain**octave / sum(texture.gain**i for i in range(texture.octaves))
    return vector((*[weight * texture.lacunarity**octave] * 3, weight))


def _wave(waves: dict[int, Procedural], *, everywhere: bool) -> list[str]:
    """Statements that make `t` and `gradient` those of marble and wood, where the sphere has one of them."""
    marble = {index: texture.kind == "marble" for index, texture in waves.items()}
    lines = chosen("vec3", "grain", {index: "vec3(1.0)" if is_marble else vector(WOOD_GRAIN)
                                     for index, is_marble in marble.items()})
    lines += chosen("float", "along", {index: "q.x" if is_marble else "length(q.xy)"
                                       for index, is_marble in marble.items()})
    lines += chosen("vec3", "ahead", {index: "vec3(1.0, 0.0, 0.0)" if is_marble else
                                      f"vec3(q.xy / max(length(q.xy), {number(1 / FAR)}), 0.0)"
                                      for index, is_marble in marble.items()})
    lines += chosen("float", "distortion", {index: number(texture.distortion) for index, texture in waves.items()})
    lines += chosen("float", "rise", {index: number(RISE[texture.kind]) for index, texture in waves.items()})
    where = "" if everywhere else f"if ({is_any(list(waves))}) "
    return [*lines, "vec2 crest = wave(along + distortion * noise.w, rise);",
            f"{where}gradient = crest.y * (ahead + distortion * grain * noise.xyz);", f"{where}t = crest.x;"]


def _ramp(textures: dict[int, tuple[Procedural, float]]) -> list[str]:
    """Statements that declare `r`, the ramp's `slope` at t, its `least` and `greatest`, and `room` up to a corner."""
    radii, slopes, least, greatest, room = {}, {}, {}, {}, {}
    for index, (texture, amplitude) in textures.items():
        stops = amplitude * np.array([color[0] for color in texture.colors])
        last = len(stops) - 1
        steps = np.diff(stops)
        if last == 1:
            radii[index] = f"{number(1 + stops[0])} + {number(steps[0])} * t"
        else:
            radii[index] = " + ".join([number(1 + stops[0]), *(
                f"ramp_step(t, {number(last)}, {number(step)}) * {number(steps[step])}" for step in range(last))])
        slopes[index] = " : ".join([*(f"t < {number((step + 1) / last)} ? {number(steps[step] * last)}"
                                      for step in range(last - 1)), number(steps[-1] * last)])
        corner = f"clamp(round(t * {number(last)}), 1.0, {number(last - 1)}) / {number(last)}"
        room[index] = number(FAR) if last == 1 else f"abs(t - {corner})"
        least[index], greatest[index] = number(steps.min() * last), number(steps.max() * last)
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
