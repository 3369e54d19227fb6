"""From a `Scene` to the GLSL chunk `scene.glsl`: the scene as literals, the fastest form measured.

The chunk defines what `lib/path.glsl` and `lib/camera.glsl` expect: MAX_DEPTH, the HAS_… switches, the camera's
constants, and intersect_scene, surface_normal, surface_uv, material, emission, is_two_sided and environment; where
something moves, set_time, to_rest and from_rest too, and where rays are long, project_hit.
"""

from __future__ import annotations

import dataclasses

from harness.scene.frame import framed, spread
from harness.scene.model import EnvironmentMap, Scene, as_matrix
from harness.scene.motion import settled
from harness.scene.strategies import parse_strategy
from harness.shader.scene.displaced import displaced, march_declarations
from harness.shader.scene.environment import environment_function
from harness.shader.scene.geometry import intersect_function, normal_function, projection_function
from harness.shader.scene.lights import light_functions, light_switches
from harness.shader.scene.literals import in_comment, number, vector
from harness.shader.scene.materials import (
    black_function,
    emission_function,
    material_function,
    switches,
    two_sided_function,
)
from harness.shader.scene.motion import Motions
from harness.shader.scene.rounding import zeroed
from harness.shader.scene.textures import declarations, uv_users
from harness.shader.scene.uv import uv_function

# Rounding leaves a hit off its shape by two or three float32 spacings (2^-24) of the length t of its ray. Where no ray
# is longer than this, that is at most a quarter of what rays are lifted off surfaces by, and to project hits onto their
# shapes would take 5 % more time and mend nothing. In the units of a scene's frame.
LONGEST_UNPROJECTED = 128.0


def scene_chunk(scene: Scene, strategy: str) -> str:
    """The text of `scene.glsl` for one scene and strategy; ends in a newline."""
    scene = _without_rounding(settled(framed(scene)))
    shapes = scene.shapes
    motions = Motions.of(scene)
    has = {**switches(shapes), "HAS_LENS": int(scene.camera.aperture_radius > 0),
           "HAS_MOTION": int(bool(motions.shapes)), "HAS_DISPLACED": int(bool(displaced(shapes))),
           "HAS_PROJECTION": int(spread(scene) > LONGEST_UNPROJECTED),
           "HAS_ENVIRONMENT_MAP": int(isinstance(scene.environment, EnvironmentMap))}
    how = parse_strategy(strategy)
    defines = {"STRATEGY": f"STRATEGY_{how.draw.upper()}", "MAX_DEPTH": scene.max_depth, **has,
               **light_switches(scene, how)}
    parts = [
        f"// Generated from the scene '{in_comment(scene.name)}' for the strategy '{strategy}'.",
        *(f"#define {name} {value}" for name, value in defines.items()),
        '#include "lib/phong.glsl"',
        '#include "lib/shapes.glsl"',
        "",
        *_camera(scene),
        *declarations(shapes),
        *motions.declarations(),
        *march_declarations(shapes, motions),
        *intersect_function(shapes, motions),
        *normal_function(shapes),
        *projection_function(shapes, needed=bool(has["HAS_PROJECTION"])),
        *uv_function(shapes, uv_users(shapes)),
        *material_function(shapes),
        *(black_function(shapes) if has["HAS_GLOSSY"] else []),
    ]
    if has["HAS_EMISSION"]:
        parts += emission_function(shapes)
    if has["HAS_TWO_SIDED"]:
        parts += two_sided_function(shapes)
    parts += environment_function(scene.environment)
    parts += light_functions(scene, how, motions)
    return "\n".join(parts).rstrip() + "\n"


def _without_rounding(scene: Scene) -> Scene:
    """The same with zeros in the transforms of its shapes and its camera where rounding has left something else."""
    camera = dataclasses.replace(scene.camera, to_world=as_matrix(zeroed(scene.camera.matrix)))
    shapes = (dataclasses.replace(shape, to_world=as_matrix(zeroed(shape.matrix))) for shape in scene.shapes)
    return dataclasses.replace(scene, camera=camera, shapes=tuple(shapes))


def _camera(scene: Scene) -> list[str]:
    camera = scene.camera
    left, up, forward, origin = (camera.matrix[:3, column] for column in range(4))
    constants: dict[str, tuple[str, str]] = {
        "CAMERA_START": ("vec3", vector(origin + camera.near_clip * forward)),
        "CAMERA_LEFT": ("vec3", vector(left)),
        "CAMERA_UP": ("vec3", vector(up)),
        "CAMERA_FORWARD": ("vec3", vector(forward)),
        "CAMERA_TAN": ("vec2", vector((camera.tan_x, camera.tan_y))),
        "CAMERA_OFFSET": ("vec2", vector(camera.principal_point)),
        "CAMERA_NEAR": ("float", number(camera.near_clip)),
        "CAMERA_FAR": ("float", number(camera.far_clip)),
    }
    if camera.aperture_radius > 0:
        constants["CAMERA_APERTURE"] = "float", number(camera.aperture_radius)
        constants["CAMERA_FOCUS"] = "float", number(camera.focus_distance)
    return [*(f"const {kind} {name} = {value};" for name, (kind, value) in constants.items()), ""]
