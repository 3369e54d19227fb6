"""GLSL for a scene's bitmaps as layers of one array, of which a vertex reads each shape's own by one lookup.

A lookup costs every lane, whatever shape it hit, and most of a textured scene's are of images that its shape does not
have. Hosts and people bind images one by one; where the device says so (harness/gpu/device.py), ours has all of them in
one array, and the layer is selected by the shape, as its coordinates are. The bits are those of one sampler an image: a
layer's sides are powers of two, so coordinates are scaled without rounding, and copies of the edges stand around each
image, so that the filter sees what its wrap would have given.
"""

from __future__ import annotations

import functools
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from harness.scene.bitmaps import bitmap_texels
from harness.scene.model import Bitmap, Matrix3, Shape
from harness.shader.scene.literals import chosen, function, is_any, vector
from harness.shader.scene.targets import Target, textures_of

# Defined as 1 by the device; 0 in scenes for which it would bring nothing.
DEFINE = "BITMAPS_AHEAD"
SAMPLER = "bitmap_layers"
# By how many lookups a vertex must be poorer. Two made course_scene 1.08 to 1.15 times as fast, three textures 1.20 to
# 1.30; area_lights, which has one image and so none to save, was 0.96 times as fast with its lookup ahead.
LEAST_SAVED = 2
# What the array may take, in bytes: all layers are as large as the largest image asks for.
MOST_BYTES = 1 << 26
_TEXEL_BYTES = 16

# What one lookup of a shape reads: an image, by what tells it from others, under a transform of (u, v).
Slot = tuple[Hashable, Matrix3]


@dataclass(frozen=True, eq=False)
class Layers:
    """The images of a scene, one a layer of `size` (width, height), and what each shape's lookups read, in order."""

    images: tuple[Bitmap, ...]
    sizes: tuple[tuple[int, int], ...]
    size: tuple[int, int]
    slots: Mapping[int, tuple[Slot, ...]]

    @property
    def lookups(self) -> int:
        """How many a vertex makes."""
        return max(map(len, self.slots.values()))

    def slot(self, index: int, bitmap: Bitmap) -> int:
        """Which of its shape's lookups reads a texture."""
        return self.slots[index].index((key(bitmap), bitmap.to_uv))


def key(bitmap: Bitmap) -> Hashable:
    """What makes two bitmaps one image with one sampler."""
    return bitmap.digest, bitmap.raw, bitmap.filter_type, bitmap.wrap_mode


def layers(shapes: Sequence[Shape]) -> Layers | None:
    """The layers of a scene's bitmaps; None where they would save too little, or take too much room."""
    found: dict[Hashable, Bitmap] = {}
    slots: dict[int, dict[Slot, None]] = {}
    apart = set()  # the lookups of one sampler an image: `material` and `emission` make their own
    for index, shape in enumerate(shapes):
        for texture in textures_of(shape):
            if isinstance(texture, Bitmap):
                found.setdefault(key(texture), texture)
                slots.setdefault(index, {})[key(texture), texture.to_uv] = None
                apart.add((key(texture), texture is shape.emission))
    if not found or len(apart) - max(map(len, slots.values())) < LEAST_SAVED:
        return None
    sizes = tuple(_size(bitmap) for bitmap in found.values())
    width, height = (1 << (max(side) + 1).bit_length() for side in zip(*sizes, strict=True))
    if width * height * len(found) * _TEXEL_BYTES > MOST_BYTES:
        return None
    return Layers(tuple(found.values()), sizes, (width, height), {index: tuple(each) for index, each in slots.items()})


def texels(found: Layers) -> np.ndarray:
    """The array, (layers, H, W, 3) float32: each image from the corner on, behind it the texel that its wrap puts
    there, and before it, which is a layer's end, the one that it puts there."""
    width, height = found.size
    made = np.zeros((len(found.images), height, width, 3), np.float32)
    for layer, bitmap in zip(made, found.images, strict=True):
        image = bitmap_texels(bitmap)
        rows, columns = image.shape[:2]
        beside = ((1, 1), (1, 1), (0, 0))
        around = np.pad(image, beside, "wrap") if bitmap.wrap_mode == "repeat" else np.pad(image, beside, "edge")
        at_y = np.r_[height - 1, 0:rows + 1]
        at_x = np.r_[width - 1, 0:columns + 1]
        layer[np.ix_(at_y, at_x)] = around
    return made


def layer_declarations(found: Layers) -> list[str]:
    """The sampler, and `look_up_bitmaps` with the variables that it sets."""
    lines = [f"// {len(found.images)} images, a layer each; layers of {found.size[0]} x {found.size[1]} texels.",
             f"uniform sampler2DArray {SAMPLER};",
             "// What the shape that was hit reads of its bitmaps.",
             f"vec3 {', '.join(_names(found))};", ""]
    body: list[str] = []
    order = {key(image): layer for layer, image in enumerate(found.images)}
    for lookup, name in enumerate(_names(found)):
        mine = {index: slots[lookup] for index, slots in sorted(found.slots.items()) if lookup < len(slots)}
        of = {index: order[image] for index, (image, _) in mine.items()}
        at = {index: transformed(to_uv) for index, (_, to_uv) in mine.items()}
        image = {index: vector((*found.sizes[layer], layer)) for index, layer in of.items()}
        kinds = {index: (found.images[layer].wrap_mode, found.images[layer].filter_type) for index, layer in of.items()}
        repeated, mirrored, nearest = ([index for index, kind in kinds.items() if word in kind]
                                       for word in ("repeat", "mirror", "nearest"))
        body += ["{", *(f"    {line}" for line in (
            *chosen("vec2", "at", at), *chosen("vec3", "image", image),
            *([f"if ({is_any(repeated)}) at -= floor(at);"] if repeated else []),
            *([f"if ({is_any(mirrored)}) at = mirrored(at);"] if mirrored else []),
            "at = clamp(at, 0.0, 1.0) * image.xy;",
            *([f"if ({is_any(nearest)}) at = floor(at) + 0.5;"] if nearest else []),
            f"at *= {vector([1 / side for side in found.size])};",
            f"{name} = textureLod({SAMPLER}, vec3(at, image.z), 0.0).rgb;")), "}"]
    return lines + function("void look_up_bitmaps(int id, vec2 uv)", body)


def layer_assignments(targets: Sequence[Target], found: Layers) -> list[str]:
    """Statements that set each target to its bitmap's value, looked up before."""
    lines = []
    for target in targets:
        for lookup, name in enumerate(_names(found)):
            ids = [index for index, texture in target.uses.items()
                   if isinstance(texture, Bitmap) and found.slot(index, texture) == lookup]
            if ids:
                lines.append(f"if ({is_any(ids)}) {target.variable} = {name}.{target.swizzle};")
    return lines


def where_ahead(lines: Sequence[str]) -> list[str]:
    """Lines for devices that look bitmaps up ahead."""
    return [f"#if {DEFINE}", *lines, "#endif"] if lines else []


def kept(found: Layers, uv: str) -> tuple[list[str], list[str]]:
    """Statements around the light of another shape at `uv`: the vertex's own bitmaps are still to be read."""
    names = _names(found)
    return ([*(f"vec3 kept_{name} = {name};" for name in names), f"look_up_bitmaps(id, {uv});"],
            [f"{name} = kept_{name};" for name in names])


@functools.lru_cache(maxsize=64)
def _size(bitmap: Bitmap) -> tuple[int, int]:
    """Width and height; of an image that a scene's text is made from several times, read once."""
    height, width = bitmap_texels(bitmap).shape[:2]
    return width, height


def transformed(matrix: Matrix3) -> str:
    """uv under `to_uv`."""
    (a, b, x), (c, d, y), _ = matrix
    moved = f" + {vector((x, y))}" if x or y else ""
    if b or c:
        return f"uv.x * {vector((a, c))} + uv.y * {vector((b, d))}{moved}"
    return ("uv" if a == d == 1 else f"uv * {vector((a, d))}") + moved


def _names(found: Layers) -> list[str]:
    return [f"texel_{lookup}" for lookup in range(found.lookups)]
