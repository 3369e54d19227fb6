"""What the functions of glsl/lib/lights.glsl should return for given arguments, in float64: see `diagnosis.expected`.

Points are drawn on rectangles, disks, cubes and cylinders evenly over what faces the origin; balls by the directions
that they cover (Shirley, Wang & Zimmerman 1996, ACM TOG 15(1)). Of N origins, all arrays have N rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.diagnosis import expected
from harness.scene.lights import area, face_areas, reach
from harness.scene.model import Shape

# What rounding may turn: heights above a light's plane below this part of the distance to it, and numbers or places
# this near to where something else is chosen.
LOW, NEAR = 2e-3, 1e-4
# Of a closed shape that shines inwards all directions are alike.
AROUND = 1 / (4 * np.pi)


@dataclass(frozen=True, eq=False)
class Towards:
    """Unit directions (N, 3), densities per steradian (N,), the distance of the point drawn (N,), 0 where a direction
    was drawn; and where rounding decides nothing, (N,)."""

    direction: np.ndarray
    density: np.ndarray
    distance: np.ndarray
    firm: np.ndarray


def towards(shape: Shape, o: np.ndarray, u: np.ndarray) -> Towards:
    """What is drawn by numbers u (N, 2) from o (N, 3), in the space in which the shape rests."""
    if shape.kind in ("sphere", "cube") and shape.flip_normals:
        return around(_inside(shape, o), u)
    match shape.kind:
        case "sphere" | "displacedsphere":
            return ball(o, shape.matrix[:3, 3], reach(shape)**2, u, outwards=shape.kind == "sphere")
        case "cube":
            return _cube(shape, o, u)
        case "cylinder":
            return _cylinder(shape, o, u)
        case _:
            return _flat(shape, o, u)


def density(shape: Shape, o: np.ndarray, t: np.ndarray, facing: np.ndarray) -> np.ndarray:
    """Per steradian, of directions that meet the lit side at the distance t, with the cosine `facing`."""
    if shape.kind in ("sphere", "cube") and shape.flip_normals:
        return np.full(len(o), AROUND)
    match shape.kind:
        case "sphere" | "displacedsphere":
            return 1 / (2 * np.pi * cap(o, shape.matrix[:3, 3], reach(shape)**2))
        case "cube":
            faced = faces(_object(shape, o), np.array(face_areas(shape))).sum(axis=1)
        case "cylinder":
            away = np.hypot(*_object(shape, o)[:, :2].T)
            faced = 2 * _arc(away, inwards=shape.flip_normals) * area(shape) / (2 * np.pi)
        case _:
            faced = np.full(len(o), area(shape))
    return t * t / (faced * facing)


def cap(o: np.ndarray, center: np.ndarray, squared_radius: np.ndarray | float) -> np.ndarray:
    """1 - cos of half the angle of a ball, (N,); 2 from inside."""
    sine = squared_radius / ((center - o)**2).sum(axis=1)
    return np.where(sine < 1, sine / (1 + np.sqrt(np.maximum(1 - sine, 0))), 2.0)


def ball(o: np.ndarray, center: np.ndarray, squared_radius: np.ndarray | float, u: np.ndarray, *,
         outwards: bool) -> Towards:
    """Directions evenly over those that a ball covers; `outwards`: it has no density from inside."""
    way = center - o
    squared = (way**2).sum(axis=1)
    axis = way / np.sqrt(squared)[:, None]
    whole = cap(o, center, squared_radius)
    direction = expected.about(axis, *expected.frame(axis), 1 - u[:, 0] * whole, u[:, 1])
    pdf = 1 / (2 * np.pi * whole)
    firm = (np.abs(squared_radius / squared - 1) > LOW) & (np.abs(axis[:, 2] - expected.TURNS_AT) > NEAR)
    return Towards(direction, np.where((squared > squared_radius) | (not outwards), pdf, 0.0), np.zeros(len(o)), firm)


def around(inside: np.ndarray, u: np.ndarray) -> Towards:
    """Every direction; no density from outside. `inside`: how far within the shape (N,), negative outside."""
    z = 1 - 2 * u[:, 0]
    sine, phi = np.sqrt(np.maximum(1 - z * z, 0)), 2 * np.pi * u[:, 1]
    direction = np.stack([sine * np.cos(phi), sine * np.sin(phi), z], axis=1)
    return Towards(direction, np.where(inside > 0, AROUND, 0.0), np.zeros(len(u)), np.abs(inside) > NEAR)


def disk(u: np.ndarray) -> np.ndarray:
    """Points (N, 2) of the unit disk: Shirley & Chiu 1997, concentric."""
    x, y = (2 * u - 1).T
    steep = np.abs(x) < np.abs(y)
    radius, other = np.where(steep, y, x), np.where(steep, x, y)
    phi = np.pi / 4 * other / np.where(radius == 0, 1, radius)
    p = radius * np.cos(phi), radius * np.sin(phi)
    return np.stack([np.where(steep, p[1], p[0]), np.where(steep, p[0], p[1])], axis=1)


def faces(q: np.ndarray, areas: np.ndarray) -> np.ndarray:
    """Of a cube's pairs of faces, (N, 3), the areas of those that face what is at q in its space."""
    return np.where(np.abs(q) > 1, areas, 0.0)


def on_point(o: np.ndarray, y: np.ndarray, height: np.ndarray, faced: np.ndarray | float) -> Towards:
    """The way to a point that is drawn with density 1 / `faced`, with o at `height` above the light's plane there."""
    way = y - o
    distance = np.linalg.norm(way, axis=1)
    with np.errstate(all="ignore"):
        pdf = np.where(height > 0, distance**3 / (faced * height), 0.0)
    return Towards(way / distance[:, None], pdf, distance, np.abs(height) > LOW * distance)


def _flat(shape: Shape, o: np.ndarray, u: np.ndarray) -> Towards:
    at = 2 * u - 1 if shape.kind == "rectangle" else disk(u)
    y = shape.matrix[:3, 3] + at @ shape.matrix[:3, :2].T
    front = np.linalg.inv(shape.matrix)[2, :3] * (-1 if shape.flip_normals else 1)
    return on_point(o, y, (o - shape.matrix[:3, 3]) @ (front / np.linalg.norm(front)), area(shape))


def _cube(shape: Shape, o: np.ndarray, u: np.ndarray) -> Towards:
    q = _object(shape, o)
    seen = faces(q, np.array(face_areas(shape)))
    whole = seen.sum(axis=1)
    at = u[:, 0] * whole
    ends = np.cumsum(seen, axis=1)
    which = np.where(at < ends[:, 0], 0, np.where(at < ends[:, 1], 1, 2))
    row = np.arange(len(o))
    with np.errstate(all="ignore"):
        first = 2 * (at - (ends - seen)[row, which]) / seen[row, which] - 1
    second = 2 * u[:, 1] - 1
    p = np.choose(which[:, None], [np.c_[0 * first, first, second], np.c_[first, 0 * first, second],
                                   np.c_[first, second, 0 * first]])
    p[row, which] = np.sign(q)[row, which]
    sizes = 1 / np.linalg.norm(np.linalg.inv(shape.matrix)[:3, :3], axis=1)
    height = np.where(whole > 0, (np.abs(q[row, which]) - 1) * sizes[which], 0.0)
    found = on_point(o, shape.matrix[:3, 3] + p @ shape.matrix[:3, :3].T, height, whole)
    firm = (np.abs(at[:, None] - ends) > NEAR * whole[:, None])[:, :2].all(axis=1) | ((seen > 0).sum(axis=1) < 2)
    return Towards(found.direction, found.density, found.distance,
                   found.firm & firm & (whole > 0) & (np.abs(np.abs(q) - 1) > NEAR).all(axis=1))


def _cylinder(shape: Shape, o: np.ndarray, u: np.ndarray) -> Towards:
    q = _object(shape, o)
    away = np.hypot(q[:, 0], q[:, 1])
    arc = _arc(away, inwards=shape.flip_normals)
    phi = (2 * u[:, 0] - 1) * arc + np.arctan2(q[:, 1], q[:, 0])
    p = np.stack([np.cos(phi), np.sin(phi), u[:, 1]], axis=1)
    radius = np.linalg.norm(shape.matrix[:3, 0])
    height = radius * ((q[:, :2] * p[:, :2]).sum(axis=1) - 1) * (-1 if shape.flip_normals else 1)
    found = on_point(o, shape.matrix[:3, 3] + p @ shape.matrix[:3, :3].T, height, 2 * arc * area(shape) / (2 * np.pi))
    return Towards(found.direction, found.density, found.distance,
                   found.firm & (arc > 0) & (np.abs(away - 1) > LOW) & (away > NEAR))


def _arc(away: np.ndarray, *, inwards: bool) -> np.ndarray:
    """Half the angle of what faces a point `away` radii from the axis."""
    return np.full(len(away), np.pi) if inwards else np.arccos(1 / np.maximum(away, 1.0))


def _object(shape: Shape, o: np.ndarray) -> np.ndarray:
    inverse = np.linalg.inv(shape.matrix)
    return np.asarray(o @ inverse[:3, :3].T + inverse[:3, 3])


def _inside(shape: Shape, o: np.ndarray) -> np.ndarray:
    q = _object(shape, o)
    return 1 - (np.linalg.norm(q, axis=1) if shape.kind == "sphere" else np.abs(q).max(axis=1))
