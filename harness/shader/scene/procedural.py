"""GLSL for the textures `fractal`, `marble` and `wood` of a scene, which share as much work as they can.

What a texture costs is its noise: some 130 instructions an octave, which every lane executes at every vertex of its
path, whatever shape it hit. So textures that no shape has together are evaluated as one, whose parameters are selected
by the shape, and textures that differ in their colours only are evaluated once. Measured on procedural.xml, five
textures: 1.7 times the cost of the scene in plain colours, and 3.4 times with each evaluated by itself.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from harness.scene.model import Procedural, Shape, Texture
from harness.scene.noise import OCTAVE, UINT32, octave_weights
from harness.scene.procedural import RISE, WOOD_GRAIN
from harness.shader.scene.literals import chosen, function, grouped, is_any, number, vector
from harness.shader.scene.targets import Target

# Textures without their colours that are evaluated as one, by the index of their shape.
Lane = dict[int, Procedural]


def lanes(shapes: Sequence[Shape]) -> list[Lane]:
    """All procedural textures, divided so that no lane holds two of one shape; one texture is always in the same lane.

    Each texture takes the first lane that holds none of those it meets on a shape.
    """
    together = [{_uncolored(texture): None for texture in _textures(shape)} for shape in shapes]
    lane_of: dict[Procedural, int] = {}
    for textures in together:
        for texture in textures:
            others = {other for group in together if texture in group for other in group}
            taken = {lane_of[other] for other in others if other in lane_of}
            lane_of.setdefault(texture, next(lane for lane in range(len(lane_of) + 1) if lane not in taken))
    found: list[Lane] = [{} for _ in range(1 + max(lane_of.values(), default=-1))]
    for index, textures in enumerate(together):
        for texture in textures:
            found[lane_of[texture]][index] = texture
    return found


def declarations(shapes: Sequence[Shape]) -> list[str]:
    """`evaluate_procedural` and the variables that it sets; nothing where no shape has such a texture."""
    needed = lanes(shapes)
    if not needed:
        return []
    lines = ['#include "lib/procedural.glsl"', "",
             "// Where the procedural textures of the shape that was hit stand on their colour ramps, within [0, 1].",
             f"float {', '.join(f'ramp_{lane}' for lane in range(len(needed)))};", ""]
    for lane, textures in enumerate(needed):
        lines += function(f"float procedural_{lane}(int id, vec3 p)", _evaluation(textures, shapes))
    return lines + function("void evaluate_procedural(int id, vec3 p)",
                            [f"ramp_{lane} = procedural_{lane}(id, p);" for lane in range(len(needed))])


def assignments(targets: Sequence[Target], shapes: Sequence[Shape]) -> list[str]:
    """Statements that set each target to the texture's colour, one for each ramp."""
    needed = lanes(shapes)
    lines: list[str] = []
    for target in targets:
        values: dict[int, str] = {}
        for index, texture in target.uses.items():
            assert isinstance(texture, Procedural)
            lane = next(lane for lane, textures in enumerate(needed) if textures.get(index) == _uncolored(texture))
            values[index] = _ramp(f"ramp_{lane}", texture, target.swizzle)
        lines += [f"if ({is_any(ids)}) {target.variable} = {value};" for value, ids in grouped(values)]
    return lines


def _textures(shape: Shape) -> list[Procedural]:
    slots: list[Texture | float | None] = [shape.material.kd, shape.material.ks, shape.material.alpha, shape.emission]
    return [texture for texture in slots if isinstance(texture, Procedural)]


def _uncolored(texture: Procedural) -> Procedural:
    return dataclasses.replace(texture, colors=())


def _evaluation(textures: Lane, shapes: Sequence[Shape]) -> list[str]:
    """Statements that return t for the texture of shape `id` at p in world space."""
    rows = {index: texture.frequency * (np.array(texture.to_texture) @ np.linalg.inv(shapes[index].matrix))
            for index, texture in textures.items()}
    lines: list[str] = []
    for axis, name in enumerate("xyz"):
        lines += chosen("vec4", f"row_{name}", {index: vector(matrix[axis]) for index, matrix in rows.items()})
    # In the order of scene.procedural.transformed, so that both renderers round alike: dot() may add up in another.
    coordinates = ", ".join(" + ".join(f"row_{name}.{axis} * p.{axis}" for axis in "xyz") + f" + row_{name}.w"
                            for name in "xyz")
    lines.append(f"vec3 q = vec3({coordinates});")
    lines += _noise(textures)
    waves = {index: texture for index, texture in textures.items() if texture.kind != "fractal"}
    if not waves:
        return [*lines, "return noise;"]
    lines += chosen("float", "along", {index: "q.x" if texture.kind == "marble" else "length(q.xy)"
                                       for index, texture in waves.items()})
    lines += chosen("float", "distortion", {index: number(texture.distortion) for index, texture in waves.items()})
    lines += chosen("float", "rise", {index: number(RISE[texture.kind]) for index, texture in waves.items()})
    lines.append("float t = wave(along + distortion * noise, rise).x;")
    if fractals := [index for index in textures if index not in waves]:
        lines.append(f"if ({is_any(fractals)}) t = noise;")
    return [*lines, "return t;"]


def _noise(textures: Lane) -> list[str]:
    """Statements that declare `noise`: the fbm of the texture of shape `id` at q, octave by octave.

    Written out, since a loop of more than about 5 octaves is not unrolled, and its iterations would count among those
    of the whole shader, of which llvmpipe allows 65,535.
    """
    # `precise`, so that compilers do not merge the factors of successive octaves: a steep texture would show the other
    # rounding of the place in a cell.
    lines = chosen("precise vec3", "cell", {index: f"q * {vector(WOOD_GRAIN)}" if texture.kind == "wood" else "q"
                                            for index, texture in textures.items()})
    lines += chosen("uint", "seed", {index: f"{texture.seed}u" for index, texture in textures.items()})
    lines += chosen("float", "lacunarity", {index: number(texture.lacunarity) for index, texture in textures.items()})
    most = max(texture.octaves for texture in textures.values())
    weights = {index: octave_weights(texture.octaves, texture.gain) + [0.0] * (most - texture.octaves)
               for index, texture in textures.items()}
    for octave in range(most):
        lines += chosen("float", f"weight_{octave}", {index: number(own[octave]) for index, own in weights.items()})
        if octave == 0:
            lines.append("float noise = weight_0 * value_noise(cell, seed);")
        else:
            lines += ["cell *= lacunarity;",
                      f"noise += weight_{octave} * value_noise(cell, seed + {octave * OCTAVE & UINT32}u);"]
    return lines


def _ramp(place: str, texture: Procedural, swizzle: str) -> str:
    """The colour at a place on the texture's ramp, piecewise linear."""
    def colour(values: np.ndarray) -> str:
        return vector(values) if swizzle == "rgb" else number(float(values[0]))

    stops = np.array(texture.colors)
    last = number(len(stops) - 1)
    steps = (f"ramp_step({place}, {last}, {number(index)}) * {colour(stops[index + 1] - stops[index])}"
             for index in range(len(stops) - 1))
    return " + ".join([colour(stops[0]), *steps])
