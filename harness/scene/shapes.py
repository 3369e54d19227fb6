"""Shapes of a scene file, in Mitsuba's canonical object space under an affine transform."""

from __future__ import annotations

import numpy as np

from harness.scene.materials import load_material
from harness.scene.model import Material, Shape, ShapeKind, Texture, as_matrix
from harness.scene.nodes import Node
from harness.scene.textures import load_texture

SHAPES: tuple[ShapeKind, ...] = ("sphere", "rectangle", "disk", "cube")


def load_shape(node: Node) -> Shape:
    """A shape with its material and its area light."""
    if node.plugin not in SHAPES:
        raise node.refuse(SHAPES)
    kind: ShapeKind = next(shape for shape in SHAPES if shape == node.plugin)
    material, emission = _surface(node)
    matrix = node.transform()
    flip = node.boolean("flip_normals", False)
    if kind == "sphere":
        matrix, flip = _sphere(node, matrix, flip)
        node.done(["center", "radius", "to_world", "flip_normals"])
    else:
        if kind == "disk":
            _refuse_unless_similarity(node, matrix, plane_only=True)
        node.done(["to_world", "flip_normals"])
    return Shape(kind, as_matrix(matrix), material, emission, flip, name=node.name)


def _surface(node: Node) -> tuple[Material, Texture | None]:
    """The nested or referenced BSDF, and the radiance of the nested area light."""
    material: Material | None = None
    emission: Texture | None = None
    for _, child in node.children():
        if child.kind == "bsdf":
            if material is not None:
                raise child.error("a shape has one BSDF; this is the second")
            material = load_material(child)
        elif child.kind == "emitter":
            if child.plugin != "area":
                raise child.refuse(["area"])
            if emission is not None:
                raise child.error("a shape has one emitter; this is the second")
            emission = load_texture(child, "radiance", 1.0, emission=True)
            child.done(["radiance"])
        else:
            raise child.refuse(["bsdf", "emitter area"])
    if material is None:
        # Mitsuba's own default: diffuse with reflectance 0.5, black for an emitter (Shape::initialize).
        grey = 0.5 if emission is None else 0.0
        material = Material((grey, grey, grey), (0.0, 0.0, 0.0), 1.0)
    return material, emission


def _sphere(node: Node, matrix: np.ndarray, flip: bool) -> tuple[np.ndarray, bool]:
    center = node.point("center", (0.0, 0.0, 0.0))
    radius = node.number("radius", 1.0)
    if radius <= 0:
        raise node.error(f"'radius' must be positive, found {radius:g}")
    _refuse_unless_similarity(node, matrix, plane_only=False)
    local = np.diag([radius, radius, radius, 1.0])
    local[:3, 3] = center
    # A mirrored sphere is turned inside out in Mitsuba (Sphere::update), unlike every other mirrored shape.
    return matrix @ local, flip ^ bool(np.linalg.det(matrix[:3, :3]) < 0)


def _refuse_unless_similarity(node: Node, matrix: np.ndarray, *, plane_only: bool) -> None:
    """Spheres stay spheres and disks circular in Mitsuba: rotation, translation and uniform scale only."""
    columns = matrix[:3, :2] if plane_only else matrix[:3, :3]
    gram = columns.T @ columns
    if not np.allclose(gram, np.eye(len(gram)) * gram[0, 0], rtol=0, atol=1e-5 * gram[0, 0]):
        raise node.error(f"'to_world' of a {node.plugin} must not shear or scale unevenly; "
                         "use rotation, translation and uniform scale")
