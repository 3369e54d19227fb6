"""Displaced spheres for Mitsuba 3: meshes with exact vertices and normals, kept in the cache.

Mitsuba has no such shape, none can be added in Python, and `sdfgrid` leaves normals off by half a degree. So the
reference shows a cube sphere: the faces of a cube, each a grid of equal angles, pushed out to the surface. Between
its vertices a mesh is off in height and, which shows more, in its interpolated normals; both fall with the square of
the edges' length.
"""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from harness.files import cache_dir, write_atomically
from harness.samples.keys import code_digest, digest
from harness.scene.displaced import normal, radius
from harness.scene.model import Displacement, Shape

# Root mean square of the angle (radians) between a mesh's interpolated normals and the surface's that is aimed at: 0.23
# degrees. Of displaced.xml, meshes with errors of 0.7, 0.2 and 0.05 degrees have image means within 1e-4 of each other,
# which is what the samples tell apart; MESH_TOLERANCE is fifty times that.
NORMAL_ERROR = 4e-3
# Cells along an edge of the cube to choose from. 256 are 800,000 triangles, 20 MB on disk, and take Mitsuba 0.1 GB; the
# finest are 3.1 million, 80 MB, and 0.4 GB. Size and error both go with the square, so the steps are small.
RESOLUTIONS = range(128, 513, 32)
# Triangles at whose middle the error is measured.
PROBES = 20_000
# Directions evaluated at once: each takes about half a kilobyte.
CHUNK = 1 << 17
# Bytes of meshes beyond which those unused for longest are removed: the scenes that come with the harness have 163 MB,
# and each change of the code that makes them makes others. None of the last hour: Mitsuba may be about to read it.
LIMIT, SPARED_SECONDS = 1 << 28, 3600.0


def become_mesh(mi: Any, props: Any, shape: Shape) -> None:
    """Turn the properties of a `displacedsphere` into those of the `ply` of its mesh; BSDF and emitter stay.

    Raises StoreError where the cache cannot be written.
    """
    assert shape.displacement is not None
    for name in ("center", "radius", "amplitude", "displacement", "to_world"):
        if name in props:
            del props[name]
    props.set_plugin_name("ply")
    mirrored = bool(np.linalg.det(shape.matrix[:3, :3]) < 0)
    props["filename"] = str(mesh_file(shape.displacement, mirrored=mirrored))
    props["to_world"] = mi.ScalarAffineTransform4d(shape.matrix)


def mesh_file(displacement: Displacement, *, mirrored: bool) -> Path:
    """A PLY file of the surface in canonical object space; made at the first call.

    `mirrored`: the triangles run clockwise seen from outside, so that a `to_world` that mirrors turns them round.
    Raises StoreError where the cache cannot be written.
    """
    name = digest([code_digest(__name__), dataclasses.asdict(displacement), mirrored], 24)
    path = cache_dir() / "meshes" / f"displaced-{name}.ply"
    if path.is_file():
        with suppress(OSError):  # a read-only cache only loses the note of when it was used
            os.utime(path)
    else:
        resolution = next((n for n in RESOLUTIONS if normal_error(displacement, n) <= NORMAL_ERROR), RESOLUTIONS[-1])
        with write_atomically(path) as partial:
            write_ply(partial, displacement, resolution, mirrored=mirrored)
        _forget(path.parent)
    return path


def _forget(folder: Path) -> None:
    """Remove meshes unused for longest until `LIMIT` is kept, whatever other processes remove meanwhile."""
    found = []
    for path in folder.glob("*.ply"):
        with suppress(OSError):
            found.append((path.stat().st_mtime, path.stat().st_size, path))
    left = sum(size for _, size, _ in found)
    for used, size, path in sorted(found):
        if left <= LIMIT or time.time() - used < SPARED_SECONDS:
            break
        with suppress(OSError):
            path.unlink()
            left -= size


def normal_error(displacement: Displacement, resolution: int) -> float:
    """Root mean square angle, radians, between interpolated and exact normals in the middle of random triangles."""
    rng = np.random.default_rng(0)
    face, row, column, half = rng.integers([6, resolution, resolution, 2], size=(PROBES, 4)).T
    corners = [_direction(_on_cube(face, row + i, column + j, resolution), resolution)
               for i, j in ((half, half), (0, 1), (1, 0))]
    middle = np.zeros((PROBES, 3))
    shading = np.zeros((PROBES, 3))
    for corner in corners:
        r, gradient = radius(displacement, corner)
        middle += corner * r[:, None]
        shading += normal(corner, r, gradient)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    shading /= np.linalg.norm(shading, axis=1, keepdims=True)
    sine = np.linalg.norm(np.cross(shading, normal(middle, *radius(displacement, middle))), axis=1)
    return float(np.sqrt((sine**2).mean()))


def write_ply(path: Path, displacement: Displacement, resolution: int, *, mirrored: bool = False) -> None:
    """Write the mesh of 6 · `resolution`² · 2 triangles, little-endian binary: float32 positions and normals."""
    places, triangles = cube_sphere(resolution)
    properties = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    header = (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(places)}\n{properties}"
              f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n")
    faces = np.empty(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"] = 3
    faces["corners"] = triangles[:, ::-1] if mirrored else triangles
    with path.open("wb") as file:
        file.write(header.encode())
        for vertices in _vertices(displacement, places, resolution):
            file.write(vertices.astype("<f4").tobytes())
        file.write(faces.tobytes())


def cube_sphere(resolution: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices as places on the surface of the integer cube [0, n]³, (V, 3), each once, so the mesh is watertight.

    And triangles, (T, 3), that run counterclockwise seen from outside.
    """
    n = resolution
    row, column = (grid.ravel() for grid in np.mgrid[:n + 1, :n + 1])
    places = np.concatenate([_on_cube(np.full_like(row, face), row, column, n) for face in range(6)])
    keys, vertex = np.unique(places @ [(n + 1)**2, n + 1, 1], return_inverse=True)
    vertex = vertex.reshape(6, n + 1, n + 1)
    a, b, c, d = vertex[:, :-1, :-1], vertex[:, 1:, :-1], vertex[:, :-1, 1:], vertex[:, 1:, 1:]
    triangles = np.stack([np.stack([a, b, c], axis=-1), np.stack([d, c, b], axis=-1)], axis=-2).reshape(6, -1, 3)
    triangles[1::2] = triangles[1::2, :, ::-1]  # opposite faces of the cube look opposite ways
    unique = np.stack([keys // (n + 1)**2, keys // (n + 1) % (n + 1), keys % (n + 1)], axis=-1)
    return unique, triangles.reshape(-1, 3)


def _on_cube(face: np.ndarray, row: np.ndarray, column: np.ndarray, resolution: int) -> np.ndarray:
    """Places on the integer cube, (N, 3): even faces lie at `resolution` on axis face // 2, odd ones at 0."""
    axis = face // 2
    places = np.empty((len(face), 3), dtype=np.int64)
    index = np.arange(len(face))
    places[index, axis] = np.where(face % 2, 0, resolution)
    places[index, (axis + 1) % 3] = row
    places[index, (axis + 2) % 3] = column
    return places


def _direction(places: np.ndarray, resolution: int) -> np.ndarray:
    """Unit directions of places on the integer cube; equal steps are equal angles on the middle lines of a face."""
    on_cube = np.tan(np.pi / 4 * (2 * places / resolution - 1))
    return np.asarray(on_cube / np.linalg.norm(on_cube, axis=1, keepdims=True))


def _vertices(displacement: Displacement, places: np.ndarray, resolution: int) -> Iterator[np.ndarray]:
    """Positions and normals, (N, 6), in order, piece by piece."""
    for start in range(0, len(places), CHUNK):
        directions = _direction(places[start:start + CHUNK], resolution)
        r, gradient = radius(displacement, directions)
        yield np.column_stack([directions * r[:, None], normal(directions, r, gradient)])
