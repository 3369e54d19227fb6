"""What textures set: GLSL variables of a material or a light, and which shapes take them from which texture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from harness.scene.model import Shape, Varying


@dataclass(frozen=True)
class Target:
    """A GLSL variable that textures set, the components that it takes of them, and the texture of each shape.

    In scope where it is set: `int id` of the shape, `vec3 p` on it (world space, the shape at rest) and `vec2 uv`.
    """

    variable: str
    swizzle: str  # "rgb", or "r" for a number
    uses: Mapping[int, Varying]


def restricted(targets: Sequence[Target], kind: type) -> list[Target]:
    """The targets with only their textures of one kind; those without any are left out."""
    few = [Target(t.variable, t.swizzle, {i: texture for i, texture in t.uses.items() if isinstance(texture, kind)})
           for t in targets]
    return [target for target in few if target.uses]


def textures_of(shape: Shape) -> Iterator[Varying]:
    """Every texture over a shape's surface: of its material and of its light, but not of its displacement."""
    for value in (shape.material.kd, shape.material.ks, shape.material.alpha, shape.emission):
        if value is not None and not isinstance(value, tuple | float | int):
            yield value
