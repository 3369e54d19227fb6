"""GLSL for what shapes are made of: their materials and their light, constant or textured."""

from __future__ import annotations

from collections.abc import Sequence

from harness.scene.model import Material, Shape, Texture, Varying, is_black, peak
from harness.shader.scene.literals import function, number, selected, vector
from harness.shader.scene.procedural import lanes
from harness.shader.scene.targets import Target
from harness.shader.scene.textures import assignments

BLACK = "vec3(0.0)"


def glossy_probability(material: Material) -> float:
    """Probability of drawing from the lobe: its share of the two terms' luminance-free weight, max over channels.

    Of a textured material, that of its peaks; the shader then computes its own at each point.
    """
    diffuse, glossy = max(peak(material.kd)), max(peak(material.ks))
    return glossy / (diffuse + glossy) if diffuse + glossy > 0 else 0.0


def switches(shapes: Sequence[Shape]) -> dict[str, int]:
    """The HAS_… switches by which the library leaves out what no material has."""
    materials = [shape.material for shape in shapes]
    return {
        "HAS_DIFFUSE": int(any(not is_black(m.kd) for m in materials)),
        "HAS_GLOSSY": int(any(not is_black(m.ks) for m in materials)),
        "HAS_EMISSION": int(any(shape.emission for shape in shapes)),
        "HAS_TWO_SIDED": int(any(m.two_sided for m in materials)),
        "HAS_PROCEDURAL": int(bool(lanes(shapes))),
    }


def material_function(shapes: Sequence[Shape]) -> list[str]:
    """`material`: the Phong parameters of shape `id` at p, whose surface coordinates are uv."""
    constants = [_constant(shape.material) for shape in shapes]
    body = selected("Material", "value", constants, f"Material({BLACK}, {BLACK}, 1.0, 0.0)")
    targets = [Target("value.kd", "rgb", _varying([s.material.kd for s in shapes])),
               Target("value.ks", "rgb", _varying([s.material.ks for s in shapes])),
               Target("value.alpha", "r", _varying([s.material.alpha for s in shapes]))]
    body += assignments(targets, shapes)
    if targets[0].uses or targets[1].uses:
        body.append("value.p_glossy = glossy_probability(value.kd, value.ks);")
    return function("Material material(int id, vec3 p, vec2 uv)", [*body, "return value;"])


def emission_function(shapes: Sequence[Shape]) -> list[str]:
    """`emission`: the radiance that leaves the front of shape `id` at p."""
    values = [shape.emission or (0.0, 0.0, 0.0) for shape in shapes]
    body = selected("vec3", "value", [_colour(value) for value in values], BLACK)
    body += assignments([Target("value", "rgb", _varying(values))], shapes)
    return function("vec3 emission(int id, vec3 p, vec2 uv)", [*body, "return value;"])


def two_sided_function(shapes: Sequence[Shape]) -> list[str]:
    """`is_two_sided`: whether shape `id` is shaded on its back."""
    body = selected("bool", "value", [str(shape.material.two_sided).lower() for shape in shapes], "false")
    return function("bool is_two_sided(int id)", [*body, "return value;"])


def black_function(shapes: Sequence[Shape]) -> list[str]:
    """`is_black`: whether shape `id` reflects nothing anywhere."""
    body = selected("bool", "value", [str(is_black(s.material.kd) and is_black(s.material.ks)).lower() for s in shapes],
                    "true")
    return function("bool is_black(int id)", [*body, "return value;"])


def _constant(material: Material) -> str:
    alpha = material.alpha if isinstance(material.alpha, float | int) else 1.0
    return (f"Material({_colour(material.kd)}, {_colour(material.ks)}, {number(alpha)}, "
            f"{number(glossy_probability(material))})")


def _colour(texture: Texture) -> str:
    """The constant's literal; black stands where a texture will."""
    return vector(texture) if isinstance(texture, tuple) else BLACK


def _varying(values: Sequence[Texture | float]) -> dict[int, Varying]:
    return {index: value for index, value in enumerate(values) if not isinstance(value, tuple | float | int)}
