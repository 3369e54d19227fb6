"""GLSL for a scene's shapes: where rays meet them and which way they face."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.scene.model import Shape, ShapeKind
from harness.tracer.displaced import displaced, march_normal
from harness.tracer.literals import function, in_comment, number, rows, vector
from harness.tracer.motion import Motions


def geometric_normal(shape: Shape) -> np.ndarray:
    """The unit normal, (3,), of a planar shape's front: object-space +z under the inverse transpose, flips applied."""
    normal = np.linalg.inv(shape.matrix)[2, :3]
    return normal / np.linalg.norm(normal) * (-1 if shape.flip_normals else 1)


def intersect_function(shapes: Sequence[Shape], motions: Motions) -> list[str]:
    """`intersect_scene`: the distance to the nearest hit within `reach`, and the shape that it is on.

    Where spheres are displaced, lib/displaced.glsl has that function, and this one, of the other shapes, is
    `intersect_shapes`.
    """
    name = "intersect_shapes" if displaced(shapes) else "intersect_scene"
    lines = [
        f"float {name}(vec3 o, vec3 d, float reach, out int id)",
        "{",
        "    float t = reach;",
        "    float s;",
        "    id = -1;",
        *(f"    {line}" for line in motions.rays()),
    ]
    for index, shape in enumerate(shapes):
        if shape.kind == "displacedsphere":
            continue
        note = f"  // {in_comment(shape.name)}" if shape.name else ""
        lines.append(f"    s = hit_{shape.kind}({motions.ray(index)}, {_placement(shape)});{note}")
        lines.append(f"    if (s < t) {{ t = s; id = {index}; }}")
    return [*lines, "    return t;", "}", ""]


def normal_function(shapes: Sequence[Shape]) -> list[str]:
    """`surface_normal`: the outward unit normal of shape `id` at p."""
    body = ["vec3 n = vec3(0.0, 0.0, 1.0);"]
    spheres = _of_kind(shapes, "sphere")
    if spheres:
        body.append("vec4 sphere = vec4(0.0, 0.0, 0.0, 1.0);  // centre, and 1 / radius with the side's sign")
        for index, shape in spheres:
            center, radius = _sphere(shape)
            value = vector((*center, (-1 if shape.flip_normals else 1) / radius))
            body.append(f"if (id == {index}) sphere = {value};")
        body.append("n = (p - sphere.xyz) * sphere.w;")
    for index, shape in enumerate(shapes):
        if shape.kind in ("rectangle", "disk"):
            body.append(f"if (id == {index}) n = {vector(geometric_normal(shape))};")
        elif shape.kind == "cube":
            columns = np.linalg.inv(shape.matrix)[:3, :3].T * (-1 if shape.flip_normals else 1)
            columns = columns / np.linalg.norm(columns, axis=0)
            matrix = f"mat3({', '.join(vector(columns[:, j]) for j in range(3))})"
            body.append(f"if (id == {index}) n = {matrix} * cube_face(p, {_placement(shape)});")
    for index, shape in _of_kind(shapes, "cylinder"):
        row_x, row_y = (vector(row) for row in np.linalg.inv(shape.matrix)[:2])
        body.append(f"if (id == {index}) n = {'-' * shape.flip_normals}cylinder_normal(p, {row_x}, {row_y});")
    body += march_normal(shapes)
    comment = "// The outward unit normal of shape `id` at p."
    return [comment, *function("vec3 surface_normal(int id, vec3 p)", [*body, "return n;"])]


def _of_kind(shapes: Sequence[Shape], kind: ShapeKind) -> list[tuple[int, Shape]]:
    return [(index, shape) for index, shape in enumerate(shapes) if shape.kind == kind]


def _placement(shape: Shape) -> str:
    if shape.kind == "sphere":
        center, radius = _sphere(shape)
        return f"{vector(center)}, {number(radius)}"
    return rows(np.linalg.inv(shape.matrix))


def _sphere(shape: Shape) -> tuple[np.ndarray, float]:
    matrix = shape.matrix
    return matrix[:3, 3], float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))
