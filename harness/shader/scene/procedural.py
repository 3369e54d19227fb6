"""GLSL for the procedural textures of a scene, which share as much work as they can.

Their formulas stand in glsl/lib/procedural.glsl, a function for each kind in `KINDS`; what is written here chooses by
the shape's id between them and between their parameters, and writes out the octaves of their noise.

What a texture costs is its noise: some 130 instructions an octave, which every lane executes at every vertex of its
path, whatever shape it hit. So textures that no shape has together are evaluated as one, whose parameters are selected
by the shape, and textures that differ in their colours only are evaluated once. Measured on procedural.xml, five
textures: 1.7 times the cost of the scene in plain colours, and 3.4 times with each evaluated by itself.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from harness.scene.model import Procedural, Shape, Texture
from harness.scene.noise import octave_weights
from harness.scene.procedural import KINDS
from harness.shader.scene.literals import chosen, function, grouped, is_any, number, vector
from harness.shader.scene.rounding import to_object
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
            colors = np.array(texture.colors)
            values[index] = (ramp(f"ramp_{lane}", colors, vector) if target.swizzle == "rgb" else
                             ramp(f"ramp_{lane}", colors[:, 0], number))
        lines += [f"if ({is_any(ids)}) {target.variable} = {value};" for value, ids in grouped(values)]
    return lines


def _textures(shape: Shape) -> list[Procedural]:
    slots: list[Texture | float | None] = [shape.material.kd, shape.material.ks, shape.material.alpha, shape.emission]
    return [texture for texture in slots if isinstance(texture, Procedural)]


def _uncolored(texture: Procedural) -> Procedural:
    return dataclasses.replace(texture, colors=())


def _evaluation(textures: Lane, shapes: Sequence[Shape]) -> list[str]:
    """Statements that return t for the texture of shape `id` at p in world space."""
    rows = {index: texture.frequency * (np.array(texture.to_texture) @ to_object(shapes[index]))
            for index, texture in textures.items()}
    lines: list[str] = []
    for axis, name in enumerate("xyz"):
        lines += chosen("vec4", f"row_{name}", {index: vector(matrix[axis]) for index, matrix in rows.items()})
    return [*lines, "vec3 q = to_cells(row_x, row_y, row_z, p);", *evaluation(textures, gradient=False),
            "return value.w;"]


def evaluation(textures: Mapping[int, Procedural], *, gradient: bool) -> list[str]:
    """Statements that declare `value`: what lib/procedural.glsl has for the texture of shape `id` at q.

    Its w is t, its xyz the gradient of t along q, or nothing of use where no `gradient` is asked for. The noise is
    written out octave by octave, since a loop of more than about 5 is not unrolled, and its iterations would count
    among those of the whole shader, of which llvmpipe of Mesa 22 allows 65,535.
    """
    # `precise`, so that compilers do not merge the factors of successive octaves: a steep texture would show the other
    # rounding of the place in a cell. Displaced surfaces are smooth, and met to MARCH_TOLERANCE only.
    lines = chosen("vec3" if gradient else "precise vec3", "cell", {
        index: _cell(texture.kind) for index, texture in textures.items()})
    lines += chosen("uint", "seed", {index: f"{texture.seed}u" for index, texture in textures.items()})
    lines += chosen("float", "lacunarity", {index: number(texture.lacunarity) for index, texture in textures.items()})
    lines.append("vec4 noise = vec4(0.0);")
    for octave in range(max(texture.octaves for texture in textures.values())):
        if octave:
            lines.append("cell *= lacunarity;")
        weights = {index: _weight(texture, octave) for index, texture in textures.items()}
        seed = f"seed + {octave}u * NOISE_OCTAVE" if octave else "seed"
        if gradient:
            lines += chosen("vec4", f"weight_{octave}", {
                index: f"NOISE_UNIT * {vector((*[weight * textures[index].lacunarity**octave] * 3, weight))}"
                for index, weight in weights.items()})
            lines.append(f"noise += weight_{octave} * cell_noise_gradient(cell, {seed});")
        else:
            lines += chosen("float", f"weight_{octave}", {index: number(weight) for index, weight in weights.items()})
            lines.append(f"noise.w += weight_{octave} * value_noise(cell, {seed});")
    # One for all, since a texture without waves has no use for it.
    distortions = {index: number(texture.distortion) for index, texture in textures.items()
                   if KINDS[texture.kind].distortion is not None}
    lines += chosen("float", "distortion", distortions or {0: "0.0"})
    return lines + chosen("vec4", "value", {index: f"{texture.kind}(q, noise, distortion)"
                                            for index, texture in textures.items()})


def ramp(place: str, stops: np.ndarray, literal: Callable[[Any], str]) -> str:
    """The value at a place on a ramp through `stops`, (N,) or (N, 3), piecewise linear; `literal` writes one."""
    last = number(len(stops) - 1)
    steps = (f"ramp_step({place}, {last}, {number(index)}) * {literal(stops[index + 1] - stops[index])}"
             for index in range(len(stops) - 1))
    return " + ".join([literal(stops[0]), *steps])


def _cell(kind: str) -> str:
    """Where a texture's noise is evaluated, as an expression of q."""
    return "q" if set(KINDS[kind].grain) == {1.0} else f"q * {kind.upper()}_GRAIN"


def _weight(texture: Procedural, octave: int) -> float:
    """What an octave counts for in a texture's noise; nothing beyond the texture's own octaves."""
    return octave_weights(texture.octaves, texture.gain)[octave] if octave < texture.octaves else 0.0
