"""GLSL for the textures `bitmap` and `checkerboard`, and which images their samplers hold.

A lookup costs every lane, whatever shape it hit: so an image is one sampler and, however many materials and lights
use it, one lookup at a vertex, whose coordinates are selected by the shape.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from typing import TypeVar

from harness.scene.model import Bitmap, Checkerboard, Matrix3, Shape
from harness.shader.scene.layers import (
    DEFINE,
    key,
    layer_assignments,
    layer_declarations,
    layers,
    transformed,
)
from harness.shader.scene.literals import chosen, grouped, in_comment, is_any, number, vector
from harness.shader.scene.targets import Target, textures_of

Placed = TypeVar("Placed", Bitmap, Checkerboard)

# GL's names of Mitsuba's filters.
FILTERS = {"bilinear": "linear", "nearest": "nearest"}


def images(shapes: Sequence[Shape]) -> list[Bitmap]:
    """The images of a scene; that at index i is the shader's sampler `bitmap<i>`.

    Bitmaps that differ in nothing but `to_uv` share one.
    """
    found: dict[Hashable, Bitmap] = {}
    for texture in (texture for shape in shapes for texture in textures_of(shape)):
        if isinstance(texture, Bitmap):
            found.setdefault(key(texture), texture)
    return list(found.values())


def declarations(shapes: Sequence[Shape]) -> list[str]:
    """The samplers, each with what a host other than ours has to bind to it, and the library."""
    kinds = {type(texture) for shape in shapes for texture in textures_of(shape)}
    head = ['#include "lib/bitmaps.glsl"', ""] if kinds & {Bitmap, Checkerboard} else []
    lines: list[str] = []
    for index, image in enumerate(images(shapes)):
        decoded = "as it is" if image.raw else "decoded from sRGB if it has 8 or 16 bits"
        wrapped = "repeat" if image.wrap_mode == "repeat" else "clamp to edge"
        lines += [f"// {in_comment(image.path.name)}, {decoded}, first row first; filter {FILTERS[image.filter_type]}, "
                  f"wrap: {wrapped}, no mipmaps.", f"uniform sampler2D bitmap{index};"]
    found = layers(shapes)
    if found is not None:
        lines = [f"#ifndef {DEFINE}", f"#define {DEFINE} 0", "#endif",
                 f"#if {DEFINE}", *layer_declarations(found)[:-1], "#else", *lines, "#endif"]
    return [*head, *lines, ""] if head else []


def bitmap_assignments(targets: Sequence[Target], shapes: Sequence[Shape]) -> list[str]:
    """Statements that set each target to its bitmap's value; `shapes` are all of the scene's."""
    if not targets:
        return []
    lines: list[str] = []
    for index, image in enumerate(images(shapes)):
        fitting = [Target(t.variable, t.swizzle, {i: b for i, b in t.uses.items()
                                                  if isinstance(b, Bitmap) and key(b) == key(image)})
                   for t in targets]
        at = "mirrored(at)" if image.wrap_mode == "mirror" else "at"
        for placement in _placements(fitting, Bitmap):
            settings = [f"if ({is_any(ids)}) {target.variable} = texel.{target.swizzle};"
                        for target in fitting if (ids := list(_placed(target, placement, Bitmap)))]
            lines += _block(placement, f"vec3 texel = bitmap(bitmap{index}, {at});", settings)
    if (found := layers(shapes)) is not None:
        return [f"#if {DEFINE}", *layer_assignments(targets, found), "#else", *lines, "#endif"]
    return lines


def checkerboard_assignments(targets: Sequence[Target]) -> list[str]:
    """Statements that set each target to its checkerboard's colour."""
    lines: list[str] = []
    for placement in _placements(targets, Checkerboard):
        settings = []
        for target in targets:
            boards = _placed(target, placement, Checkerboard)
            colors = {index: _colors(board, target.swizzle) for index, board in boards.items()}
            settings += [f"if ({is_any(ids)}) {target.variable} = {value};" for value, ids in grouped(colors)]
        lines += _block(placement, "bool is_first = is_first_color(at);", settings)
    return lines


def _placements(targets: Sequence[Target], kind: type[Placed]) -> list[dict[int, Matrix3]]:
    """The fewest lookups, each with one `to_uv` of each shape: as many as the `to_uv` of a shape's textures differ."""
    of_shape: dict[int, dict[Matrix3, None]] = {}
    for target in targets:
        for index, texture in target.uses.items():
            if isinstance(texture, kind):
                of_shape.setdefault(index, {})[texture.to_uv] = None
    lookups = max(map(len, of_shape.values()), default=0)
    return [{index: list(matrices)[n] for index, matrices in sorted(of_shape.items()) if n < len(matrices)}
            for n in range(lookups)]


def _placed(target: Target, placement: Mapping[int, Matrix3], kind: type[Placed]) -> dict[int, Placed]:
    """The target's textures that one lookup serves, by shape."""
    return {index: texture for index, texture in target.uses.items()
            if isinstance(texture, kind) and texture.to_uv == placement.get(index)}


def _colors(board: Checkerboard, swizzle: str) -> str:
    first, second = (vector(color) if swizzle == "rgb" else number(color[0]) for color in (board.color0, board.color1))
    return f"is_first ? {first} : {second}"


def _block(placement: Mapping[int, Matrix3], lookup: str, settings: Sequence[str]) -> list[str]:
    """One lookup in a scope of its own."""
    coordinates = chosen("vec2", "at", {index: transformed(matrix) for index, matrix in placement.items()})
    return ["{", *(f"    {line}" for line in (*coordinates, lookup, *settings)), "}"]
