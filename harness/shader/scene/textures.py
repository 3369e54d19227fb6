"""GLSL for textures: statements that replace constants of a material or a light by what varies over the surface.

The dispatch alone; each kind of texture has a module of its own.
"""

from __future__ import annotations

from collections.abc import Sequence

from harness.scene.model import Bitmap, Checkerboard, Procedural, Shape
from harness.shader.scene import bitmaps, procedural, uv
from harness.shader.scene.targets import Target, restricted, textures_of


def assignments(targets: Sequence[Target], shapes: Sequence[Shape]) -> list[str]:
    """Statements that set each target where the shape has a texture for it; `shapes` are all of the scene's."""
    return [
        *bitmaps.checkerboard_assignments(restricted(targets, Checkerboard)),
        *bitmaps.bitmap_assignments(restricted(targets, Bitmap), shapes),
        *procedural.assignments(restricted(targets, Procedural), shapes),
    ]


def declarations(shapes: Sequence[Shape]) -> list[str]:
    """Includes, uniforms and functions that the statements need."""
    return [
        *uv.uv_include(uv_users(shapes)),
        *bitmaps.declarations(shapes),
        *procedural.declarations(shapes),
    ]


def uv_users(shapes: Sequence[Shape]) -> list[int]:
    """The shapes of which a texture looks at (u, v), by their index."""
    return [index for index, shape in enumerate(shapes)
            if any(isinstance(texture, Bitmap | Checkerboard) for texture in textures_of(shape))]
