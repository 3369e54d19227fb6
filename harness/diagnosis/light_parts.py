"""The functions that light sampling is made of, each by itself against its definition: see `diagnosis.parts`.

Asked once a question about a light differs, innermost first: which of those behind it is wrong.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from harness.diagnosis import expected_lights
from harness.diagnosis.parts import near, unless
from harness.errors import ShaderError
from harness.gpu.probes import evaluate
from harness.scene.lights import face_areas
from harness.scene.model import Material, Shape, ShapeKind, as_matrix
from harness.shader.library import Library

_ROWS = 4096
_MIDDLE = np.array([0.1, -0.2, 0.3])
# Half the edges of what is flat and of the cube; the tube's radius and length; the largest ball's squared radius.
_SIZES, _TUBE, _LARGEST = (0.7, 0.5, 0.9), (0.6, 0.6, 1.3), 2.25
# Rows of the environment map that a tent is drawn in.
_MAP_ROWS = 32
_BLACK = Material((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0)
_ROUNDING = 2e-3
# Those behind the directions and densities of a light of each kind, innermost first; -1 stands for the environment.
BEHIND = {
    "sphere": ("ball_cap", "sample_ball", "sample_sphere", "sample_around", "pdf_ball"),
    "displacedsphere": ("ball_cap", "sample_ball", "pdf_ball"),
    "rectangle": ("towards", "pdf_area", "sample_rectangle"),
    "disk": ("towards", "pdf_area", "sample_disk_light"),
    "cube": ("towards", "pdf_area", "faces_seen", "sample_cube", "sample_around", "pdf_cube"),
    "cylinder": ("towards", "pdf_area", "cylinder_arc", "sample_cylinder", "pdf_cylinder"),
    "environment": ("sample_cap", "sample_tent", "place_in_run"),
}


def wrong_light_parts(library: Library, names: tuple[str, ...]) -> list[str]:
    """Which of the functions `names` of lib/lights.glsl, mis.glsl and environment.glsl are wrong."""
    try:
        with np.errstate(all="ignore"):
            found = set(_wrong(library)) if names else set()
    except ShaderError:
        return []  # a library that names its functions otherwise keeps its stage's name
    return [name for name in names if name in found]


def _wrong(library: Library) -> Iterator[str]:
    rng = np.random.default_rng(5)
    o, height = rng.uniform(-2, 2, (_ROWS, 3)), rng.uniform(-1, 1, _ROWS)
    u, positive = rng.random((_ROWS, 2)), rng.uniform(0.1, 3, (_ROWS, 2))
    more = np.c_[rng.random(_ROWS), rng.uniform(0.2, 3, _ROWS), rng.uniform(0.1, 1, _ROWS),
                 rng.integers(0, _MAP_ROWS // 2, _ROWS)]
    o, height, u, positive, more = (_rounded(each) for each in (o, height, u, positive, more))
    turn = _turn()
    said = [evaluate("light_parts.frag", np.c_[o, height], np.c_[u, positive], more, outputs=8, library=library,
                     uniforms={"middle": tuple(_MIDDLE), "edges": _columns(turn * _SIZES),
                               "tube": _columns(turn * _TUBE), "rows": float(_MAP_ROWS), "part": part})
            for part in (0, 1)]
    first, second = (each.astype(np.float64).reshape(_ROWS, 8, 4) for each in said)
    t, facing = more[:, 1], more[:, 2]
    wanted = expected_lights.on_point(o, np.tile(_MIDDLE, (_ROWS, 1)), height, positive[:, 0])
    yield from unless(_alike(first[:, 0], wanted) and near(first[:, 1, 0], 0.9999 * wanted.distance, 2e-5), "towards")
    yield from unless(_close(first[:, 1, 1], t * t / (positive[:, 0] * facing)), "pdf_area")
    squared = _LARGEST * more[:, 0]
    cap = expected_lights.cap(o, _MIDDLE, squared)
    yield from unless(_close(first[:, 1, 2], cap), "ball_cap")
    yield from unless(_close(first[:, 1, 3], 1 / (2 * np.pi * first[:, 1, 2])), "pdf_ball")
    ball = expected_lights.ball(o, _MIDDLE, squared, u, outwards=False)
    yield from unless(_alike(first[:, 2], ball), "sample_ball")
    outwards = expected_lights.ball(o, _MIDDLE, squared, u, outwards=True)
    lit = np.where(outwards.density > 0, first[:, 2, 3], 0)
    yield from unless(_close(first[outwards.firm, 3, 0], lit[outwards.firm]), "sample_sphere")
    inside = expected_lights.around(np.ones(_ROWS), u)
    yield from unless(_alike(first[:, 4], inside) and not second[:, 4, 2].any(), "sample_around")
    arc = np.arccos(1 / np.maximum(positive[:, 1], 1))
    yield from unless(near(first[:, 3, 1], arc, 1e-3), "cylinder_arc")
    rectangle, disk = _shape("rectangle", turn * _SIZES), _shape("disk", turn * _SIZES)
    yield from unless(_alike(first[:, 5], expected_lights.towards(rectangle, o, u)), "sample_rectangle")
    yield from unless(_alike(first[:, 6], expected_lights.towards(disk, o, u)), "sample_disk_light")
    yield from _wrong_cubes(first, second, turn, o, u, t, facing)
    for drawn, met, flip in ((second[:, 1], first[:, 3, 3], False), (second[:, 2], second[:, 3, 0], True)):
        tube = _shape("cylinder", turn * _TUBE, flip=flip)
        wanted = expected_lights.towards(tube, o, u)
        yield from unless(_alike(drawn, wanted), "sample_cylinder")
        seen, density = wanted.firm, expected_lights.density(tube, o, t, facing)
        yield from unless(_close(met[seen], density[seen]), "pdf_cylinder")
    yield from unless(near(second[:, 3, 3], positive[:, 0] / positive.sum(axis=1), 1e-4), "mis_weight")
    yield from _wrong_map_draws(second, u, more)


def _wrong_cubes(first: np.ndarray, second: np.ndarray, turn: np.ndarray, o: np.ndarray, u: np.ndarray, t: np.ndarray,
                 facing: np.ndarray) -> Iterator[str]:
    cube = _shape("cube", turn * _SIZES)
    q = (o - _MIDDLE) @ turn / _SIZES
    areas = np.array(face_areas(cube))
    yield from unless(near(first[:, 7, :3], expected_lights.faces(q, areas), 1e-4), "faces_seen")
    drawn = expected_lights.towards(cube, o, u)
    yield from unless(_alike(second[:, 0], drawn), "sample_cube")
    seen = drawn.firm
    yield from unless(_close(first[seen, 3, 2], expected_lights.density(cube, o, t, facing)[seen]), "pdf_cube")


def _wrong_map_draws(second: np.ndarray, u: np.ndarray, more: np.ndarray) -> Iterator[str]:
    """Draws under a tent: lib/environment.glsl's comments say what is even in what."""
    angle = np.pi / (_MAP_ROWS - 1)
    # Of a cap's half angle: z - sin z grows evenly.
    z = np.sort(np.linspace(0, angle, 4096))
    grown = (z - np.sin(z)) / (angle - np.sin(angle))
    half = np.sin(0.5 * np.interp(u[:, 0], grown, z))
    yield from unless(_close(second[:, 3, 1], half, 5e-3), "sample_cap")
    row = more[:, 3]
    half_angle = np.where(row < 0.5, np.arcsin(second[:, 3, 1]), np.arcsin(np.sin(angle / 2) * np.sqrt(u[:, 0])))
    middle = 0.5 * angle * row
    low, high = np.sin(middle - half_angle)**2, np.sin(middle + half_angle)**2
    low = np.where(row < 0.5, 0, low)
    yield from unless(_close(second[:, 3, 2], low + u[:, 1] * (high - low), 5e-3), "sample_tent")
    at = more[:, 0] * 7.0
    firm = np.abs(at - np.rint(at)) > 1e-4
    yield from unless(near(second[firm, 4, :2], np.c_[3 + np.floor(at), at - np.floor(at)][firm], 1e-3), "place_in_run")


def _alike(found: np.ndarray, wanted: expected_lights.Towards) -> bool:
    """Whether directions and densities, (N, 4), are those, where rounding decides nothing."""
    lit = wanted.firm & (wanted.density > 0)
    dark = wanted.firm & (wanted.density == 0)
    return (near(found[lit, :3], wanted.direction[lit], 1e-3) and _close(found[lit, 3], wanted.density[lit])
            and not (found[dark, 3] > 0).any())


def _close(found: np.ndarray, wanted: np.ndarray, rounding: float = _ROUNDING) -> bool:
    """Nearly everywhere, as parts of what is wanted."""
    return near(found / np.where(wanted == 0, 1, wanted), np.where(wanted == 0, 0, 1), rounding)


def _rounded(values: np.ndarray) -> np.ndarray:
    """The values that the shader is given: float32's, as float64."""
    return values.astype(np.float32).astype(np.float64)


def _turn() -> np.ndarray:
    """A rotation whose columns lie along no axis."""
    axis = np.array([1, 2, 2]) / 3
    cross = np.cross(np.eye(3), axis)
    return np.eye(3) + np.sin(0.7) * cross + (1 - np.cos(0.7)) * cross @ cross


def _columns(matrix: np.ndarray) -> tuple[float, ...]:
    return tuple(matrix.T.ravel().tolist())


def _shape(kind: ShapeKind, axes: np.ndarray, *, flip: bool = False) -> Shape:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = axes, _MIDDLE
    return Shape(kind, as_matrix(matrix), _BLACK, (1.0, 1.0, 1.0), flip_normals=flip)
