"""Surface coordinates of every shape under every transform, against Mitsuba's own intersections."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from harness.shader.scene.chunk import scene_chunk
from tests.support.tracer import evaluate

RAYS = 4000
BOARD = '<bsdf type="diffuse"><texture type="checkerboard" name="reflectance"/></bsdf>'
# What float32 leaves of an angle about a point at the distances in play, in turns or parts of a face.
TOLERANCE = 1e-5
# Closer to the axis an angle is lost to rounding, in parts of the shape's size: float32 spacing over TOLERANCE.
AXIS = 0.05


def rotation(rng: np.random.Generator) -> np.ndarray:
    """A random rotation, (3, 3)."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.linalg.det(q)


def shape_xml(kind: str, name: str, matrix: np.ndarray, flip: bool) -> str:
    """A shape with a texture that looks at (u, v)."""
    values = " ".join(repr(float(v)) for v in matrix.ravel())
    return (f'<shape type="{kind}" id="{name}"><transform name="to_world"><matrix value="{values}"/></transform>'
            f'<boolean name="flip_normals" value="{str(flip).lower()}"/>{BOARD}</shape>')


def random_matrix(rng: np.random.Generator, kind: str) -> np.ndarray:
    """A transform that Mitsuba takes for the shape: mirrored half the time, uneven where that is allowed."""
    linear = rotation(rng) * rng.uniform(0.3, 1.5)
    if kind in ("rectangle", "cube", "disk"):
        linear = linear @ np.diag(rng.uniform(0.5, 1.5, 3)) @ (rotation(rng) if kind != "disk" else np.eye(3))
    matrix = np.eye(4)
    matrix[:3, :3] = linear @ np.diag([rng.choice([-1, 1]), 1, 1])
    matrix[:3, 3] = rng.uniform(-2, 2, 3)
    return matrix


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("kind", ["sphere", "rectangle", "disk", "cube", "cylinder"])
def test_surface_coordinates_are_mitsubas(mi: Any, scene: Any, kind: str, seed: int) -> None:
    """Five shapes, mirrored and flipped among them; hits near a seam or the axis, where both round, excepted."""
    rng = np.random.default_rng([seed, *map(ord, kind)])
    matrices = [random_matrix(rng, kind) for _ in range(5)]
    body = "\n".join(shape_xml(kind, f"shape{i}", m, bool(i % 2)) for i, m in enumerate(matrices))
    loaded = scene(body)
    mitsuba_scene = mi.load_file(str(loaded.path), optimize=False)

    chosen = rng.integers(len(matrices), size=RAYS)
    targets = np.einsum("nij,nj->ni", np.stack(matrices)[chosen], np.c_[rng.uniform(-1, 1, (RAYS, 3)), np.ones(RAYS)])
    o = rng.normal(size=(RAYS, 3)) * 4
    d = targets[:, :3] - o
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    si = mitsuba_scene.ray_intersect(mi.Ray3f(mi.Point3f(o.T.astype(np.float32)), mi.Vector3f(d.T.astype(np.float32))))
    ids = np.full(RAYS, -1)
    for shape in mitsuba_scene.shapes():
        ids[np.array(si.shape == mi.ShapePtr(shape))] = int(shape.id().removeprefix("shape"))
    hit = ids >= 0
    assert hit.mean() > 0.3 and len(set(ids[hit])) == 5

    p, expected = np.array(si.p).T[hit], np.array(si.uv).T[hit]
    found = evaluate("uv.frag", np.c_[p, ids[hit]], generated={"scene.glsl": scene_chunk(loaded, "mixture")})[:, :2]
    q = np.einsum("nij,nj->ni", np.linalg.inv(np.stack(matrices))[ids[hit]], np.c_[p, np.ones(len(p))])[:, :3]
    clear = np.ones(len(p), dtype=bool)
    if kind in ("sphere", "disk", "cylinder"):
        clear = (np.hypot(q[:, 0], q[:, 1]) > AXIS) & ~((q[:, 0] > 0) & (np.abs(q[:, 1]) < 1e-4))
    elif kind == "cube":
        ordered = np.sort(np.abs(q), axis=1)
        clear = ordered[:, 2] - ordered[:, 1] > 1e-4
    assert clear.mean() > 0.9
    np.testing.assert_allclose(found[clear], expected[clear], rtol=0, atol=TOLERANCE)


def test_only_shapes_with_such_a_texture_pay(scene: Any) -> None:
    """No texture, no arithmetic: the function returns a constant; with one, only its kind of shape is looked at."""
    plain = scene_chunk(scene('<shape type="sphere"/><shape type="disk"/>'), "mixture")
    assert "lib/uv.glsl" not in plain
    one = scene_chunk(scene(f'<shape type="sphere">{BOARD}</shape><shape type="disk"/>'), "mixture")
    assert "uv_sphere(q)" in one and "uv_disk" not in one
