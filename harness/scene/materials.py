"""BSDFs of a scene file, as the course's Phong-like material."""

from __future__ import annotations

import dataclasses

from harness.scene.model import Material, peak
from harness.scene.nodes import Node
from harness.scene.textures import load_scalar, load_texture

BSDFS = ("phong", "diffuse", "twosided")

BLACK = (0.0, 0.0, 0.0)


def load_material(node: Node) -> Material:
    """A BSDF node as a `Material`; refuses other plugins and parameters outside their range."""
    if node.plugin == "twosided":
        inner = [child for _, child in node.children()]
        if len(inner) != 1 or inner[0].kind != "bsdf":
            raise node.error(f"'twosided' takes exactly one nested BSDF, found {len(inner)}")
        node.done([])
        return dataclasses.replace(load_material(inner[0]), two_sided=True)
    if node.plugin == "diffuse":
        material = Material(load_texture(node, "reflectance", 0.5), BLACK, 1.0)
        _refuse_children(node)
        node.done(["reflectance"])
    elif node.plugin == "phong":
        material = Material(load_texture(node, "kd", 0.5), load_texture(node, "ks", 0.0),
                            load_scalar(node, "alpha", 10.0))
        _refuse_children(node)
        node.done(["kd", "ks", "alpha"])
        if isinstance(material.alpha, float) and material.alpha < 0:
            raise node.error(f"'alpha' must not be negative, found {material.alpha:g}")
    else:
        raise node.refuse(BSDFS)
    if (albedo := max(peak(material.kd))) > 1:
        raise node.error(f"diffuse albedo must not exceed 1, found {albedo:g}")
    return material


def _refuse_children(node: Node) -> None:
    for _, child in node.children():
        raise child.refuse([f"colours, numbers and textures in a {node.plugin}"])
