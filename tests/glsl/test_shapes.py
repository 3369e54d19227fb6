"""Every shape under every transform: hits, distances, normals and emission against Mitsuba's own intersections."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.scene import Scene
from harness.shader.scene.chunk import scene_chunk
from tests.support.tracer import evaluate

NO_HIT = 1e30  # lib/shapes.glsl
KINDS = ["sphere", "rectangle", "disk", "cube", "cylinder"]
RAYS = 6000
# Twice the float32 spacing at the largest coordinates in play (8): what a distance along a ray may be off by,
# measured at right angles to the surface, where grazing incidence does not magnify it.
DISTANCE_TOLERANCE = 2e-6
SMALLEST_RADIUS = 0.3
NORMAL_TOLERANCE = DISTANCE_TOLERANCE / SMALLEST_RADIUS
# What Mitsuba's cylinder is off by against float64: it solves the quadratic equation as it stands, which cancels.
MITSUBA_CYLINDER_ERROR = 2e-5
SHARPEST_CYLINDER = 0.1  # least radius of curvature of those that are not round
# Rays whose fate changes within this distance are decided by rounding, in either renderer.
MARGIN = 3e-4


def trace(scene: Scene, o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The tracer's (t, id, normal, emission) of rays from `o` along `d`, both (N, 3)."""
    rays = np.c_[o, np.full(len(o), NO_HIT)], np.c_[d, np.zeros(len(d))]
    found = evaluate("intersect.frag", *rays, outputs=2, generated={"scene.glsl": scene_chunk(scene, "mixture")})
    return found[:, 3], found[:, 7].astype(int), found[:, :3], found[:, 4:7]


def trace_mitsuba(mi: Any, scene: Any, names: list[str], o: np.ndarray,
                  d: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The same of Mitsuba; the normal is the shading frame's, which decides sides for BSDFs and emitters."""
    import drjit as dr

    si = scene.ray_intersect(mi.Ray3f(mi.Point3f(o.T), mi.Vector3f(d.T)))
    which = mi.Int32(-1)
    for shape in scene.shapes():
        which = dr.select(si.shape == mi.ShapePtr(shape), names.index(shape.id()), which)
    light = si.emitter(scene).eval(si)
    dr.eval(si, which, light)  # in one kernel: each array by itself would trace all rays anew
    ids, emitted = np.array(which), np.array(light).T
    hit = np.array(si.is_valid())
    return (np.where(hit, np.array(si.t), NO_HIT), ids, np.where(hit[:, None], np.array(si.sh_frame.n).T, 0),
            np.where(hit[:, None], emitted, 0))


def rotation(rng: np.random.Generator) -> np.ndarray:
    """A random rotation, (3, 3)."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.linalg.det(q)


def random_transform(rng: np.random.Generator, kind: str, *, emits: bool) -> np.ndarray:
    """Any (4, 4) that Mitsuba renders rightly for the shape; mirrored half the time, uneven and leaning if allowed."""
    linear = rotation(rng) * rng.uniform(SMALLEST_RADIUS, 1.5)
    lit_cylinder = kind == "cylinder" and emits
    if kind != "sphere" and not lit_cylinder:
        linear = linear @ np.diag(rng.uniform(0.4, 1.6, 3)) @ rotation(rng)
    matrix = np.eye(4)
    matrix[:3, :3] = linear if lit_cylinder else linear * rng.choice([-1, 1], size=3)  # mirrors world axes
    matrix[:3, 3] = rng.uniform(-1.5, 1.5, 3)
    return matrix


def random_shape(rng: np.random.Generator, kind: str, name: str, *, flip: bool, emits: bool) -> str:
    """A shape under a random transform; a cylinder has random ends as well, in the unit cube."""
    matrix = random_transform(rng, kind, emits=emits)
    extra = ""
    if kind == "cylinder":
        (x0, y0, z0), (x1, y1, z1) = rng.uniform(-1, 1, (2, 3))
        extra = (f'<point name="p0" x="{x0}" y="{y0}" z="{z0}"/><point name="p1" x="{x1}" y="{y1}" z="{z1}"/>'
                 f'<float name="radius" value="{rng.uniform(0.6, 1)}"/>')
    return shape_xml(kind, name, matrix, flip=flip, emits=emits, extra=extra)


def shape_xml(kind: str, name: str, matrix: np.ndarray, *, flip: bool, emits: bool, extra: str = "") -> str:
    """One shape; `emits` gives it a radiance of its own."""
    values = " ".join(repr(float(v)) for v in matrix.ravel())
    colour = ", ".join(str(1 + sum(map(ord, name)) % 97 + k) for k in range(3))
    light = f'<emitter type="area"><rgb name="radiance" value="{colour}"/></emitter>' if emits else ""
    return (f'<shape type="{kind}" id="{name}">{extra}<transform name="to_world"><matrix value="{values}"/></transform>'
            f'<boolean name="flip_normals" value="{str(flip).lower()}"/>{light}<bsdf type="diffuse"/></shape>')


def rays_for(rng: np.random.Generator, matrices: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Rays in float32 from outside and inside, along the shapes' own axes, and grazing their planes and silhouettes."""
    def local(count: int, spread: float) -> np.ndarray:
        """Points around randomly chosen shapes: object-space coordinates up to `spread`."""
        chosen = np.stack(matrices)[rng.integers(len(matrices), size=count)]
        return np.einsum("nij,nj->ni", chosen[:, :3, :3], rng.uniform(-spread, spread, (count, 3))) + chosen[:, :3, 3]

    part = RAYS // 4
    outside = rng.normal(size=(part, 3))
    outside *= 6 / np.linalg.norm(outside, axis=1, keepdims=True)
    inside = local(part, 0.95)
    origins = [outside, inside, local(part, 3), local(part, 3)]
    axes = np.stack(matrices)[rng.integers(len(matrices), size=part)][:, :3, :3]
    sign = rng.choice([-1, 1], (part, 1))
    along = sign * np.take_along_axis(axes, rng.integers(3, size=(part, 1, 1)), axis=2)[:, :, 0]
    leaning = sign * (axes @ np.array([1.0, 0.7, 0.0])) + 0.02 * axes[:, :, 2]
    directions = [local(part, 1.2) - outside, rng.normal(size=(part, 3)), along, leaning]
    o, d = np.concatenate(origins), np.concatenate(directions)
    return o.astype(np.float32), (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)


def assert_same_hits(mi: Any, scene: Scene, rng: np.random.Generator) -> None:
    """Both renderers meet the same shape at the same place with the same normal and emission."""
    names = [shape.name for shape in scene.shapes]
    mitsuba_scene = mi.load_file(str(scene.path), optimize=False)  # would merge rectangles and cubes into one mesh
    o, d = rays_for(rng, [shape.matrix for shape in scene.shapes])
    t, ids, normals, emitted = trace_mitsuba(mi, mitsuba_scene, names, o, d)
    decided = np.ones(len(o), dtype=bool)
    for shift in np.float32(MARGIN) * np.vstack([np.eye(3), -np.eye(3)]).astype(np.float32):
        _, near_ids, near_normals, _ = trace_mitsuba(mi, mitsuba_scene, names, o + shift, d)
        decided &= (near_ids == ids) & (np.sum(near_normals * normals, axis=1) >= 0.9 * (ids >= 0))
    assert decided.mean() > 0.95 and (ids[decided] >= 0).mean() > 0.2

    found_t, found_ids, found_normals, found_emission = (values[decided] for values in trace(scene, o, d))
    np.testing.assert_array_equal(found_ids, ids[decided])
    across = np.abs(np.sum(normals * d, axis=1))[decided]
    on_cylinder = np.array([shape.kind == "cylinder" for shape in scene.shapes])[found_ids] & (found_ids >= 0)
    off = np.abs(found_t - t[decided]) * across
    np.testing.assert_array_less(off, np.where(on_cylinder, MITSUBA_CYLINDER_ERROR, DISTANCE_TOLERANCE))
    turned = np.abs(found_normals - normals[decided]).max(axis=1)
    np.testing.assert_array_less(turned[~on_cylinder], NORMAL_TOLERANCE)
    # The normal turns as the point slides along the ray.
    np.testing.assert_array_less((turned * across)[on_cylinder], MITSUBA_CYLINDER_ERROR / SHARPEST_CYLINDER)
    np.testing.assert_array_equal(found_emission, emitted[decided])


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", KINDS)
def test_shapes_are_hit_as_in_mitsuba(mi: Any, scene: Any, kind: str, seed: int) -> None:
    """Six shapes of a kind, each under a random transform, mirrored or flipped or both, half of them emissive."""
    rng = np.random.default_rng([seed, *map(ord, kind)])
    body = "\n".join(random_shape(rng, kind, f"shape{i}", flip=bool(i % 2), emits=i % 3 != 0) for i in range(6))
    assert_same_hits(mi, scene(body), rng)


def test_mixed_shapes_are_hit_as_in_mitsuba(mi: Any, scene: Any) -> None:
    """The nearest of shapes of every kind wins, whatever their order in the file."""
    rng = np.random.default_rng(7)
    kinds = rng.permutation(KINDS * 3)
    body = "\n".join(random_shape(rng, kind, f"shape{i}", flip=False, emits=True) for i, kind in enumerate(kinds))
    assert_same_hits(mi, scene(body), rng)


TURN = '<rotate y="0.6" z="0.8" angle="50"/>'
NESTED = {
    "turned, stretched, turned": TURN + '<scale x="0.6" y="1.3" z="0.9"/><rotate x="1" angle="-70"/>',
    "mirrored by a scale": '<scale x="-0.8" y="0.8" z="0.8"/>' + TURN + '<translate x="0.3" y="-0.2" z="0.4"/>',
    "mirrored twice": '<scale x="-1"/>' + TURN + '<scale y="-1"/>',
    "through a point": '<scale value="-1.2"/>' + TURN + '<translate z="0.5"/>',
    "sheared by a matrix": '<matrix value="1 0.4 0 0.1  0 0.8 0.3 0  -0.2 0 1.1 0.2  0 0 0 1"/>' + TURN,
    "placed by a lookat": '<scale value="0.7"/><lookat origin="0.5, 1, 0.2" target="-1, 0.3, 1" up="0, 1, 0.2"/>',
    "a lookat stretched": '<lookat origin="0, 1, 0" target="1, 0, 1" up="0, 1, 0"/><scale y="1.5"/>',
}
SIMILAR = ("mirrored by a scale", "mirrored twice", "through a point", "placed by a lookat")


@pytest.mark.parametrize("name", NESTED)
def test_operations_nest_as_in_mitsuba(mi: Any, scene: Any, tmp_path: Path, name: str) -> None:
    """Every shape under several operations, plain and flipped, from the file itself or one that it includes."""
    def body(kinds: list[str]) -> str:
        return "\n".join(
            f'<shape type="{kind}" id="{kind} {flip}"><transform name="to_world">{NESTED[name]}'
            # Apart along every axis: which of two surfaces in one plane is met is a matter of rounding.
            f'<translate x="{2 * flip - 1}" y="{0.6 * KINDS.index(kind) - 1.2}" z="{0.37 * KINDS.index(kind) - 0.7}"/>'
            f'</transform><boolean name="flip_normals" value="{str(flip).lower()}"/></shape>'
            for kind in kinds for flip in (False, True))
    kinds = [kind for kind in KINDS if kind != "sphere" or name in SIMILAR]
    (tmp_path / "part.xml").write_text(f'<scene version="3.0.0">{body(kinds[2:])}</scene>', encoding="utf-8")
    assert_same_hits(mi, scene(body(kinds[:2]) + '<include filename="part.xml"/>'), np.random.default_rng(3))


def exact_cylinder(matrix: np.ndarray, o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance to x² + y² = 1, 0 <= z <= 1 under `matrix` (NO_HIT beside it), and outward normal, in float64."""
    inverse = np.linalg.inv(matrix)
    origin, direction = o @ inverse[:3, :3].T + inverse[:3, 3], d @ inverse[:3, :3].T
    a, b, c = ((x[:, :2] * y[:, :2]).sum(axis=1) for x, y in ((direction, direction), (origin, direction),
                                                              (origin, origin)))
    discriminant = b * b - a * (c - 1)
    root = np.sqrt(np.maximum(discriminant, 0))
    t = np.full(len(o), NO_HIT)
    for candidate in ((-b + root) / a, (-b - root) / a):
        z = origin[:, 2] + candidate * direction[:, 2]
        t = np.where((discriminant >= 0) & (candidate > 0) & (z >= 0) & (z <= 1), candidate, t)
    p = origin + np.where(t < NO_HIT, t, 0)[:, None] * direction
    normal = (p * [1, 1, 0]) @ inverse[:3, :3]
    return t, normal / np.linalg.norm(normal, axis=1, keepdims=True)


@pytest.mark.parametrize("distance", [1.0, 1000.0])
@pytest.mark.parametrize("radius", [1.0, 1e-3])
def test_cylinders_are_hit_where_float64_says(scene: Any, radius: float, distance: float) -> None:
    """Round and oval, thick and thin as a wire, near and far: within a few roundings of the coordinates in play.

    The quadratic formula as it stands would be off by the distance squared over the radius.
    """
    rng = np.random.default_rng([int(1 / radius), int(distance)])
    for uneven in (False, True):
        linear = rotation(rng) @ np.diag([radius, radius * (0.5 if uneven else 1), 2.0])
        matrix = np.eye(4)
        matrix[:3, :3] = linear @ (np.eye(3) + uneven * 0.3 * np.outer([1, 0.5, 0], [0, 0, 1]))
        loaded = scene(shape_xml("cylinder", "wire", matrix, flip=uneven, emits=False))
        target = np.c_[rng.uniform(-1, 1, (2000, 2)), rng.uniform(0.1, 0.9, 2000), np.ones(2000)] @ matrix.T
        direction = rng.normal(size=(2000, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        o = (target[:, :3] - distance * direction).astype(np.float32)
        d = direction.astype(np.float32)
        exact, normal = exact_cylinder(loaded.shapes[0].matrix, o.astype(np.float64), d.astype(np.float64))
        t, ids, found_normal, _ = trace(loaded, o, d)
        # Rounding of such coordinates in units of the radius; an oval's normal turns up to 4 times as far.
        rounding = 2e-7 * (1 + distance) / radius
        missed = (exact < NO_HIT) != (ids == 0)
        assert missed.mean() <= 0.1 * rounding + 1e-3
        both = (exact < NO_HIT) & (ids == 0)
        assert both.mean() > 0.8
        across = np.abs(np.sum(normal * d, axis=1))[both]
        np.testing.assert_array_less(np.abs(t - exact)[both] * across, 2 * rounding * radius)
        turned = np.abs(found_normal - (-normal if uneven else normal)).max(axis=1)[both]
        np.testing.assert_array_less(turned * across, 4 * rounding)


@pytest.mark.parametrize("zero", [0.0, -0.0])
@pytest.mark.parametrize(("kind", "expected"), [
    ("sphere", [4.0, NO_HIT, NO_HIT, 1.0, NO_HIT]),
    ("rectangle", [5.0, NO_HIT, NO_HIT, NO_HIT, NO_HIT]),
    ("disk", [5.0, NO_HIT, NO_HIT, NO_HIT, NO_HIT]),
    ("cube", [4.0, NO_HIT, NO_HIT, 1.0, NO_HIT]),
    ("cylinder", [NO_HIT, NO_HIT, NO_HIT, 1.0, NO_HIT]),
])
def test_rays_along_the_axes(scene: Any, kind: str, expected: list[float], zero: float) -> None:
    """Rays with two components exactly zero, of either sign: dividing by them must neither invent nor lose a hit."""
    o = np.array([[0, 0, 5], [2, 0, 5], [-2, -2, 5], [0, 0, 0], [2, 0, 0]], dtype=np.float32)
    d = np.array([[zero, zero, -1]] * 3 + [[zero, 1, zero]] * 2, dtype=np.float32)
    t, *_ = trace(scene(f'<shape type="{kind}"/>'), o, d)
    np.testing.assert_array_equal(t, np.float32(expected))


def test_a_cube_face_has_a_unit_normal_on_edges_and_corners(scene: Any) -> None:
    """Where two or three faces meet one of them is chosen; their sum would not be a unit vector."""
    corners = np.array([[1, 1, 1], [-1, 1, 0], [0, -1, -1], [1, 0, 1]], dtype=np.float32)
    towards = -corners / np.linalg.norm(corners, axis=1, keepdims=True)
    _, ids, normals, _ = trace(scene('<shape type="cube"/>'), 2 * corners, towards)
    assert (ids == 0).all()
    np.testing.assert_array_equal(np.sort(np.abs(normals), axis=1), [[0, 0, 1]] * 4)


def test_normals_of_spheres_are_unit_where_hits_are_off(scene: Any) -> None:
    """A ball of radius 0.01 at 100: float32 knows points there to 4e-6 only, 4e-4 of the radius."""
    rng = np.random.default_rng(11)
    d = rng.normal(size=(1000, 3)).astype(np.float32)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    o = (np.array([100, -100, 100]) - d).astype(np.float32)
    _, ids, normals, _ = trace(scene('<shape type="sphere"><point name="center" x="100" y="-100" z="100"/>'
                                     '<float name="radius" value="0.01"/></shape>'), o, d)
    assert (ids == 0).mean() > 0.9
    np.testing.assert_allclose(np.linalg.norm(normals[ids == 0].astype(np.float64), axis=1), 1, rtol=0, atol=3e-7)


def test_a_hit_beyond_the_reach_is_none(scene: Any) -> None:
    """`reach` ends a ray: the far clip plane of the camera relies on it."""
    body = '<shape type="sphere"/>'
    chunk = {"scene.glsl": scene_chunk(scene(body), "cosine")}
    found = evaluate("intersect.frag", np.array([[0, 0, 5, 4.5], [0, 0, 5, 3.5]]), np.array([[0, 0, -1, 0]] * 2),
                     outputs=2, generated=chunk)
    np.testing.assert_array_equal(found[:, 3], [4.0, 3.5])
    np.testing.assert_array_equal(found[:, 7], [0, -1])
