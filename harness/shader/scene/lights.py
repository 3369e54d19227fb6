"""GLSL for the lights of a scene as something to sample: which one, a direction towards it, and its density.

What lib/path.glsl expects where LIGHTS is not 0: choose_light, sample_light, light_radiance, and for multiple
importance sampling met_light_pdf and environment_light_pdf. The shapes' formulas stand in lib/lights.glsl.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from harness.scene.lights import ENVIRONMENT, Light, area, face_areas, lights_sampled, reach
from harness.scene.model import Bitmap, EnvironmentMap, Procedural, Scene, Shape
from harness.scene.strategies import LIGHTS, Strategy
from harness.shader.scene.displaced import march_steps
from harness.shader.scene.environment import sampling_functions
from harness.shader.scene.geometry import geometric_normal
from harness.shader.scene.layers import kept, layers, where_ahead
from harness.shader.scene.literals import chosen, function, is_any, number, vector
from harness.shader.scene.motion import Motions
from harness.shader.scene.procedural import lanes
from harness.shader.scene.textures import uv_users

# Shapes that are met from inside in every direction, where they shine inwards.
CLOSED = ("sphere", "cube")


def light_switches(scene: Scene, strategy: Strategy) -> dict[str, object]:
    """The defines that say how light is found; LIGHTS is 0 where there is none to sample."""
    if not strategy.samples_lights:
        return {}
    lights = [light.shape for light in lights_sampled(scene, strategy.lights)]
    return {"LIGHTS": LIGHTS.index(strategy.lights) if lights else 0,
            "HEURISTIC": f"HEURISTIC_{strategy.heuristic.upper()}",
            "HAS_LIGHT_CHOICE": int(len(lights) > 1),
            "HAS_SHAPE_LIGHTS": int(any(index != ENVIRONMENT for index in lights)),
            "HAS_SKY_LIGHT": int(ENVIRONMENT in lights)}


def path_iterations(scene: Scene, strategy: Strategy) -> int:
    """Iterations of the tracer's loop that one sample takes at most: its vertices, and where spheres are displaced the
    steps of each ray's march, which one to a light has as well."""
    marches = 1 + march_steps(scene.shapes)
    return scene.max_depth * marches * (2 if marches > 1 and strategy.samples_lights else 1)


def light_functions(scene: Scene, strategy: Strategy, motions: Motions) -> list[str]:
    """The functions; nothing where no light is sampled."""
    lights = lights_sampled(scene, strategy.lights)
    if not lights:
        return []
    shapes = {light.shape: scene.shapes[light.shape] for light in lights if light.shape != ENVIRONMENT}
    has_sky = any(light.shape == ENVIRONMENT for light in lights)
    map_ = scene.environment if has_sky and isinstance(scene.environment, EnvironmentMap) else None
    parts = ['#include "lib/lights.glsl"', '#include "lib/mis.glsl"', "",
             *(_map_sampling(map_, strategy) if map_ else []), *_choice(lights),
             *_sampling(scene, shapes, motions, has_sky=has_sky), *_radiance(scene, shapes, motions)]
    return [*parts, *_densities(lights, shapes, motions)] if strategy.lights == "mis" else parts


def _map_sampling(map_: EnvironmentMap, strategy: Strategy) -> list[str]:
    """Beside directions that the BSDF draws, those of the map need not find what is dim."""
    return sampling_functions(map_, compensated=strategy.lights == "mis")


def _choice(lights: Sequence[Light]) -> list[str]:
    first, *others = lights
    body = [f"chance = {number(first.chance)};", f"int id = {first.shape};"]
    start = first.chance
    for light in others:
        body.append(f"if (u >= {number(start)}) {{ id = {light.shape}; chance = {number(light.chance)}; }}")
        start += light.chance
    return ["// A light by its chance, for u in [0, 1): the index of its shape, or -1 for the environment.",
            *function("int choose_light(float u, out float chance)", [*body, "return id;"])]


def _sampling(scene: Scene, shapes: Mapping[int, Shape], motions: Motions, *, has_sky: bool) -> list[str]:
    body = ["LightSample found = LightSample(n, 0.0, 0.0);"]
    if shapes:
        body.append(_at_rest(motions))
    for way, some in _ways(shapes).items():
        lines = [*_placed(some, way), f"found = {_CALLS[way][0]};"]
        alone = len(some) == len(shapes) and not has_sky
        body += lines if alone else [f"if ({is_any(list(some))}) {{", *(f"    {line}" for line in lines), "}"]
    if motions.shapes and shapes:
        body.append("found.l = from_rest(id, found.l);")
    if has_sky and isinstance(scene.environment, EnvironmentMap):
        body += ["float sky_pdf;", "vec3 sky = sample_environment(pick, u, sky_pdf);",
                 "if (id < 0) found = LightSample(sky, sky_pdf, 0.0);"]
    elif has_sky:
        body += ["vec3 sky = sample_cosine(n, u);",
                 "if (id < 0) found = LightSample(sky, pdf_cosine(dot(n, sky)), 0.0);"]
    return ["// A direction from o, on a surface with normal n, towards the light `id`; pick and u in [0, 1).",
            *function("LightSample sample_light(int id, vec3 o, vec3 n, float pick, vec2 u)", [*body, "return found;"])]


def _radiance(scene: Scene, shapes: Mapping[int, Shape], motions: Motions) -> list[str]:
    if not shapes:
        return []
    textured = any(isinstance(shape.emission, Procedural) for shape in shapes.values())
    ramps = range(len(lanes(scene.shapes)) if textured else 0)
    uv = "surface_uv(id, rest)" if set(uv_users(scene.shapes)).intersection(shapes) else "vec2(0.0)"
    ahead = layers(scene.shapes) if any(isinstance(shape.emission, Bitmap) for shape in shapes.values()) else None
    looked_up = kept(ahead, uv) if ahead else ([], [])
    body = [f"vec3 rest = {'to_rest(id, p)' if motions.shapes else 'p'};",
            *(f"float kept_{lane} = ramp_{lane};" for lane in ramps),  # the vertex's own material is still to be read
            *(["evaluate_procedural(id, rest);"] if textured else []),
            *where_ahead(looked_up[0]),
            f"vec3 radiance = emission(id, rest, {uv});",
            *where_ahead(looked_up[1]),
            *(f"ramp_{lane} = kept_{lane};" for lane in ramps)]
    if marched := [index for index, shape in shapes.items() if shape.kind == "displacedsphere"]:
        normal = "surface_normal(id, rest)"
        normal = f"from_rest(id, {normal})" if motions.shapes else normal
        body.append(f"if (({is_any(marched)}) && dot({normal}, d) >= 0.0) radiance = vec3(0.0);")
    return ["// What the light `id` sends back along the ray d that met it at p.",
            *function("vec3 light_radiance(int id, vec3 p, vec3 d)", [*body, "return radiance;"])]


def _densities(lights: Sequence[Light], shapes: Mapping[int, Shape], motions: Motions) -> list[str]:
    parts = []
    chances = {light.shape: number(light.chance) for light in lights}
    if shapes:
        body = ["float pdf = 0.0;", *chosen("float", "chance", {index: chances[index] for index in shapes}),
                _at_rest(motions)]
        for way, some in _ways(shapes).items():
            body += [f"if ({is_any(list(some))}) {{", *(f"    {line}" for line in _placed(some, way)),
                     f"    pdf = {_CALLS[way][1]};", "}"]
        parts += ["// The density, per steradian, with which a vertex at o samples the direction of a ray that has met",
                  "// the shape `id` at the distance t, with the cosine `facing`; 0 where that is no light.",
                  *function("float met_light_pdf(int id, vec3 o, float t, float facing)",
                            [*body, "return chance * pdf;"])]
    if ENVIRONMENT in chances:
        parts += ["// And that of a direction in which a ray has escaped.",
                  *function("float environment_light_pdf(vec3 d)",
                            [f"return {chances[ENVIRONMENT]} * pdf_environment(d);"])]
    return parts


def _at_rest(motions: Motions) -> str:
    return f"vec3 at = {'to_rest(id, o)' if motions.shapes else 'o'};"


def _ways(shapes: Mapping[int, Shape]) -> dict[str, dict[int, Shape]]:
    """The lights by the function of lib/lights.glsl that draws towards them."""
    found: dict[str, dict[int, Shape]] = {}
    for index, shape in shapes.items():
        found.setdefault(_way(shape), {})[index] = shape
    return found


def _way(shape: Shape) -> str:
    if shape.kind in CLOSED and shape.flip_normals:
        return "around a ball" if shape.kind == "sphere" else "around a cube"
    return shape.kind


# What samples each, and the density of a direction that met it.
_CALLS = {
    "sphere": ("sample_sphere(at, ball.xyz, ball.w, u)", "pdf_ball(at, ball.xyz, ball.w)"),
    "displacedsphere": ("sample_ball(at, ball.xyz, ball.w, u)", "pdf_ball(at, ball.xyz, ball.w)"),
    "around a ball": ("sample_around(u, dot(at - ball.xyz, at - ball.xyz) < ball.w)", "INV_FOUR_PI"),
    "around a cube": ("sample_around(u, max(max(abs(q.x), abs(q.y)), abs(q.z)) < 1.0)", "INV_FOUR_PI"),
    "rectangle": ("sample_rectangle(at, middle, edge_x, edge_y, front, area, u)", "pdf_area(t, facing, area)"),
    "disk": ("sample_disk_light(at, middle, edge_x, edge_y, front, area, u)", "pdf_area(t, facing, area)"),
    "cube": ("sample_cube(at, q, middle, axes, areas, sizes, u)", "pdf_cube(q, areas, t, facing)"),
    "cylinder": ("sample_cylinder(at, q, middle, axes, radius, half_area, side, u)",
                 "pdf_cylinder(q, half_area, side, t, facing)"),
}


# What those calls take of a shape besides `at` and `q`, o in the shape's own space, as type, name and literal.
_Choice = tuple[str, str, Callable[[Shape], str]]
_BALL: tuple[_Choice, ...] = (("vec4", "ball", lambda s: vector((*s.matrix[:3, 3], reach(s)**2))),)
_ROWS: tuple[_Choice, ...] = (("vec4", "row_x", lambda s: _row(s, 0)), ("vec4", "row_y", lambda s: _row(s, 1)),
                              ("vec4", "row_z", lambda s: _row(s, 2)))
_MIDDLE: _Choice = ("vec3", "middle", lambda s: vector(s.matrix[:3, 3]))
_AXES: _Choice = ("mat3", "axes", lambda s: f"mat3({', '.join(vector(column) for column in s.matrix[:3, :3].T)})")
_FLAT: tuple[_Choice, ...] = (_MIDDLE, ("vec3", "edge_x", lambda s: vector(s.matrix[:3, 0])),
                              ("vec3", "edge_y", lambda s: vector(s.matrix[:3, 1])),
                              ("vec3", "front", lambda s: vector(geometric_normal(s))),
                              ("float", "area", lambda s: number(area(s))))
_TAKEN: dict[str, tuple[_Choice, ...]] = {
    "sphere": _BALL, "displacedsphere": _BALL, "around a ball": _BALL, "around a cube": _ROWS,
    "rectangle": _FLAT, "disk": _FLAT,
    "cube": (*_ROWS, _MIDDLE, _AXES, ("vec3", "areas", lambda s: vector(face_areas(s))),
             ("vec3", "sizes", lambda s: vector(1 / np.linalg.norm(np.linalg.inv(s.matrix)[:3, :3], axis=1)))),
    "cylinder": (*_ROWS, _MIDDLE, _AXES, ("float", "radius", lambda s: number(float(np.linalg.norm(s.matrix[:3, 0])))),
                 ("float", "half_area", lambda s: number(area(s) / (2 * np.pi))),
                 ("float", "side", lambda s: "-1.0" if s.flip_normals else "1.0")),
}
_IN_OBJECT = "vec3 q = vec3(dot(row_x, vec4(at, 1.0)), dot(row_y, vec4(at, 1.0)), dot(row_z, vec4(at, 1.0)));"


def _placed(shapes: Mapping[int, Shape], way: str) -> list[str]:
    """Statements that declare what the calls take of the shape `id`."""
    lines: list[str] = []
    for kind, name, literal in _TAKEN[way]:
        lines += chosen(kind, name, {index: literal(shape) for index, shape in shapes.items()})
    return [*lines, _IN_OBJECT] if _ROWS[0] in _TAKEN[way] else lines


def _row(shape: Shape, axis: int) -> str:
    return vector(np.linalg.inv(shape.matrix)[axis])
