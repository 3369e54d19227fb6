"""GLSL for textures: statements that replace constants of a material or a light by what varies over the surface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from harness.scene.model import Scene, Varying


@dataclass(frozen=True)
class Target:
    """A GLSL variable that textures set, the components that it takes of them, and the texture of each shape.

    In scope where it is set: `int id` of the shape, `vec3 p` on it (world space, the shape at rest) and `vec2 uv`.
    """

    variable: str
    swizzle: str  # "rgb", or "r" for a number
    uses: Mapping[int, Varying]


def assignments(targets: Sequence[Target]) -> list[str]:
    """Statements that set each target where the shape has a texture for it."""
    return []


def declarations(scene: Scene) -> list[str]:
    """Includes, uniforms and functions that the statements need."""
    return []


def needs_uv(scene: Scene) -> bool:
    """Whether any texture of the scene looks at (u, v)."""
    return False
