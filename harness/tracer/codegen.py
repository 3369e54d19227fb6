"""From a `Scene` to the GLSL chunk `scene.glsl`: the scene as literals, the fastest form measured.

The chunk defines what `lib/path.glsl` and `lib/camera.glsl` expect: MAX_DEPTH, the HAS_… switches, the camera's
constants, and intersect_scene, surface_normal, material, emission, is_two_sided and environment.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from harness.scene.model import Material, Scene, Shape

# Literals outside this range are written with an exponent, which is shorter.
SMALLEST_POSITIONAL, LARGEST_POSITIONAL = 1e-4, 1e7

STRATEGIES = ("uniform", "cosine", "phong", "lobes", "mixture")


def scene_chunk(scene: Scene, strategy: str) -> str:
    """The text of `scene.glsl` for one scene and strategy; ends in a newline."""
    shapes = scene.shapes
    materials = [shape.material for shape in shapes]
    switches = {
        "STRATEGY": f"STRATEGY_{strategy.upper()}",
        "MAX_DEPTH": scene.max_depth,
        "HAS_DIFFUSE": int(any(max(m.kd) > 0 for m in materials)),
        "HAS_GLOSSY": int(any(max(m.ks) > 0 for m in materials)),
        "HAS_EMISSION": int(any(shape.emission for shape in shapes)),
        "HAS_TWO_SIDED": int(any(m.two_sided for m in materials)),
    }
    parts = [
        f"// Generated from the scene '{_in_comment(scene.name)}' for the strategy '{strategy}'.",
        *(f"#define {name} {value}" for name, value in switches.items()),
        '#include "lib/phong.glsl"',
        '#include "lib/shapes.glsl"',
        "",
        *_camera(scene),
        *_intersect(shapes),
        *_normal(shapes),
        *_by_id("Material", "material", [_material(m) for m in materials], "Material(vec3(0.0), vec3(0.0), 1.0, 0.0)"),
    ]
    if switches["HAS_EMISSION"]:
        parts += _by_id("vec3", "emission", [_vec(shape.emission or (0, 0, 0)) for shape in shapes], "vec3(0.0)")
    if switches["HAS_TWO_SIDED"]:
        parts += _by_id("bool", "is_two_sided", [str(m.two_sided).lower() for m in materials], "false")
    parts += ["vec3 environment(vec3 d)", "{", f"    return {_vec(scene.environment)};", "}"]
    return "\n".join(parts) + "\n"


def glossy_probability(material: Material) -> float:
    """Probability of drawing from the lobe: its share of the two terms' luminance-free weight, max over channels."""
    diffuse, glossy = max(material.kd), max(material.ks)
    return glossy / (diffuse + glossy) if diffuse + glossy > 0 else 0.0


def geometric_normal(shape: Shape) -> np.ndarray:
    """The unit normal, (3,), of a planar shape's front: object-space +z under the inverse transpose, flips applied."""
    normal = np.linalg.inv(shape.matrix)[2, :3]
    return normal / np.linalg.norm(normal) * (-1 if shape.flip_normals else 1)


def _camera(scene: Scene) -> list[str]:
    camera = scene.camera
    left, up, forward, origin = (camera.matrix[:3, column] for column in range(4))
    constants: dict[str, tuple[str, str]] = {
        "CAMERA_ORIGIN": ("vec3", _vec(origin)),
        "CAMERA_LEFT": ("vec3", _vec(left)),
        "CAMERA_UP": ("vec3", _vec(up)),
        "CAMERA_FORWARD": ("vec3", _vec(forward)),
        "CAMERA_TAN": ("vec2", _vec((camera.tan_x, camera.tan_y))),
        "CAMERA_OFFSET": ("vec2", _vec(camera.principal_point)),
        "CAMERA_NEAR": ("float", _float(camera.near_clip)),
        "CAMERA_FAR": ("float", _float(camera.far_clip)),
    }
    return [*(f"const {kind} {name} = {value};" for name, (kind, value) in constants.items()), ""]


def _intersect(shapes: Sequence[Shape]) -> list[str]:
    lines = [
        "float intersect_scene(vec3 o, vec3 d, float reach, out int id)",
        "{",
        "    float t = reach;",
        "    float s;",
        "    id = -1;",
    ]
    for index, shape in enumerate(shapes):
        note = f"  // {_in_comment(shape.name)}" if shape.name else ""
        lines.append(f"    s = hit_{shape.kind}(o, d, {_placement(shape)});{note}")
        lines.append(f"    if (s < t) {{ t = s; id = {index}; }}")
    return [*lines, "    return t;", "}", ""]


def _normal(shapes: Sequence[Shape]) -> list[str]:
    lines = ["// The outward unit normal of shape `id` at p.", "vec3 surface_normal(int id, vec3 p)", "{",
             "    vec3 n = vec3(0.0, 0.0, 1.0);"]
    spheres = [(i, s) for i, s in enumerate(shapes) if s.kind == "sphere"]
    if spheres:
        lines.append("    vec4 sphere = vec4(0.0, 0.0, 0.0, 1.0);  // centre, and 1 / radius with the side's sign")
        for index, shape in spheres:
            center, radius = _sphere(shape)
            value = _vec((*center, (-1 if shape.flip_normals else 1) / radius))
            lines.append(f"    if (id == {index}) sphere = {value};")
        lines.append("    n = (p - sphere.xyz) * sphere.w;")
    for index, shape in enumerate(shapes):
        if shape.kind in ("rectangle", "disk"):
            lines.append(f"    if (id == {index}) n = {_vec(geometric_normal(shape))};")
        elif shape.kind == "cube":
            columns = np.linalg.inv(shape.matrix)[:3, :3].T * (-1 if shape.flip_normals else 1)
            columns = columns / np.linalg.norm(columns, axis=0)
            matrix = f"mat3({', '.join(_vec(columns[:, j]) for j in range(3))})"
            lines.append(f"    if (id == {index}) n = {matrix} * cube_face(p, {_placement(shape)});")
    return [*lines, "    return n;", "}", ""]


def _placement(shape: Shape) -> str:
    if shape.kind == "sphere":
        center, radius = _sphere(shape)
        return f"{_vec(center)}, {_float(radius)}"
    rows = np.linalg.inv(shape.matrix)[:3]
    return ", ".join(_vec(row) for row in rows)


def _sphere(shape: Shape) -> tuple[np.ndarray, float]:
    matrix = shape.matrix
    return matrix[:3, 3], float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))


def _material(material: Material) -> str:
    return (f"Material({_vec(material.kd)}, {_vec(material.ks)}, {_float(material.alpha)}, "
            f"{_float(glossy_probability(material))})")


def _by_id(kind: str, name: str, values: Sequence[str], otherwise: str) -> list[str]:
    """A function of the shape's id: a chain of selects, one per distinct value; the commonest is the default."""
    groups: dict[str, list[int]] = {}
    for index, value in enumerate(values):
        groups.setdefault(value, []).append(index)
    ordered = sorted(groups.items(), key=lambda item: -len(item[1]))
    lines = [f"{kind} {name}(int id)", "{", f"    {kind} value = {ordered[0][0] if ordered else otherwise};"]
    for value, ids in ordered[1:]:
        lines.append(f"    if ({' || '.join(f'id == {index}' for index in ids)}) value = {value};")
    return [*lines, "    return value;", "}", ""]


def _in_comment(name: str) -> str:
    """A name that cannot end its line's comment or continue it: printable ASCII without the backslash."""
    return re.sub(r"[^ -\[\]-~]", "?", name)


def _vec(values: Any) -> str:
    return f"vec{len(values)}({', '.join(map(_float, values))})"


def _float(value: float) -> str:
    """The shortest decimal that reads back as the same float32.

    By dragon4 itself: str() follows NumPy's print options, which a notebook or a package (colour-science) may change.
    """
    number = np.float32(value) + np.float32(0)  # + 0 turns -0 into 0, which compilers fold away
    if number == 0 or SMALLEST_POSITIONAL <= abs(number) < LARGEST_POSITIONAL:
        return np.format_float_positional(number, trim="0")
    return np.format_float_scientific(number, trim="0")
