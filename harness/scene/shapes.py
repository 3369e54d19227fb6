"""Shapes of a scene file, in Mitsuba's canonical object space under an affine transform."""

from __future__ import annotations

import numpy as np

from harness.scene.displaced import load_displacement, refuse_surface_textures
from harness.scene.materials import load_material
from harness.scene.model import Material, Shape, ShapeKind, Texture, as_matrix
from harness.scene.motion import load_motion
from harness.scene.nodes import FLOAT32_MAX, Node
from harness.scene.textures import load_texture

# What each shape takes besides `to_world`, `flip_normals` and `motion`.
PARAMETERS: dict[ShapeKind, tuple[str, ...]] = {
    "sphere": ("center", "radius"), "rectangle": (), "disk": (), "cube": (), "cylinder": ("p0", "p1", "radius"),
    "displacedsphere": ("center", "radius", "amplitude", "displacement"),
}
# How far two edges of a frame may be from equal and at right angles, relative to their squared length: what float32
# leaves of composed rotations. An area that is off by as much is far below any tolerance.
EVENNESS = 1e-5
EVEN = "rotation (about an axis of length 1), translation and uniform scale"


def load_shape(node: Node) -> Shape:
    """A shape with its material and its area light."""
    if node.plugin not in PARAMETERS:
        raise node.refuse(PARAMETERS)
    kind: ShapeKind = next(shape for shape in PARAMETERS if shape == node.plugin)
    displacement = load_displacement(node, _radius(node)) if kind == "displacedsphere" else None
    material, emission = _surface(node)
    matrix = node.transform()
    flip = node.boolean("flip_normals", False)
    if kind == "sphere":
        matrix, flip = _sphere(node, matrix, flip)
    elif kind == "displacedsphere":
        matrix, _ = _sphere(node, matrix, flip)  # its front stays outside when mirrored
        refuse_surface_textures(node, material, emission)
    elif kind == "cylinder":
        matrix = _cylinder(node, matrix, emits=emission is not None)
    motion = load_motion(node)
    node.done((*PARAMETERS[kind], "to_world", "flip_normals", "motion"))
    _refuse_extremes(node, matrix)
    return Shape(kind, as_matrix(matrix), material, emission, flip, motion, displacement, node.name)


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
    """The sphere's place in the world, and whether its front lies inside."""
    center = node.point("center", (0.0, 0.0, 0.0))
    radius = _radius(node)
    if not _is_even(matrix[:3, :3]):  # Mitsuba makes some sphere of it, of another size
        raise node.error(f"'to_world' of a {node.plugin} must not shear or scale unevenly; use {EVEN}")
    local = np.diag([radius, radius, radius, 1.0])
    local[:3, 3] = center
    # A mirrored sphere is turned inside out in Mitsuba (Sphere::update), unlike every other mirrored shape.
    return matrix @ local, flip ^ bool(np.linalg.det(matrix[:3, :3]) < 0)


def _cylinder(node: Node, matrix: np.ndarray, *, emits: bool) -> np.ndarray:
    """The cylinder's place in the world, p0 at z = 0 and p1 at z = 1 of its object space.

    Mitsuba meets and shades a cylinder rightly under any transform. But a light it samples as if it were round and
    upright, and one that is mirrored as if its normals pointed the other way.
    """
    # In float32, as Mitsuba: the axis of points far from the origin hangs on their rounding.
    start = node.point("p0", (0.0, 0.0, 0.0)).astype(np.float32).astype(np.float64)
    end = node.point("p1", (0.0, 0.0, 1.0)).astype(np.float32).astype(np.float64)
    radius = _radius(node)
    length = float(np.linalg.norm(end - start))
    if length == 0:
        raise node.error(f"'p0' and 'p1' must differ, found {', '.join(f'{c:g}' for c in start)} for both")
    local = np.eye(4)
    local[:3, :3] = _frame((end - start) / length) * [radius, radius, length]
    local[:3, 3] = start
    placed = matrix @ local
    radial, axial = np.linalg.norm(placed[:3, [0, 2]], axis=0)
    if emits and not _is_even(placed[:3, :3] / [1, 1, axial / radial]):
        raise node.error("'to_world' of a cylinder that emits must keep it round and upright, since Mitsuba samples it "
                         f"as if it were; use {EVEN}, and scale along its axis")
    if emits and np.linalg.det(placed[:3, :3]) < 0:
        raise node.error("'to_world' of a cylinder that emits must not mirror it, since Mitsuba would light its other "
                         "side; mirror 'p0' and 'p1' instead")
    return placed


def _frame(z: np.ndarray) -> np.ndarray:
    """Columns x, y and z of Mitsuba's `coordinate_system`, (3, 3): Duff et al. 2017, JCGT 6(1), listing 3."""
    sign = np.copysign(1.0, z[2])
    a = -1 / (sign + z[2])
    b = z[0] * z[1] * a
    return np.array([[1 + sign * z[0] ** 2 * a, b, z[0]],
                     [sign * b, sign + z[1] ** 2 * a, z[1]],
                     [-sign * z[0], -z[1], z[2]]])


def _radius(node: Node) -> float:
    radius = node.number("radius", 1.0)
    if radius <= 0:
        raise node.error(f"'radius' must be positive, found {radius:g}")
    return radius


def _is_even(columns: np.ndarray) -> bool:
    """Whether edges, the columns of (3, N), are of one length and at right angles."""
    gram = columns.T @ columns
    return np.allclose(gram, np.eye(len(gram)) * gram[0, 0], rtol=0, atol=EVENNESS * gram[0, 0])


def _refuse_extremes(node: Node, matrix: np.ndarray) -> None:
    """Both renderers square lengths in float32, in the world and in object space."""
    largest = np.sqrt(FLOAT32_MAX)
    if not (np.abs(matrix) < largest).all():
        raise node.error(f"the {node.plugin} is too large or too far away for float32; scale the scene down")
    if not (np.abs(np.linalg.inv(matrix)) < largest).all():
        raise node.error(f"the {node.plugin} is too small for float32, or for its distance from the origin; "
                         "scale it up")
