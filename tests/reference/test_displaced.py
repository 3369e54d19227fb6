"""The meshes that stand for displaced spheres in Mitsuba: watertight, exact at their vertices, made once."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.api import render, render_reference
from harness.errors import StoreError
from harness.policy import judge
from harness.reference import displaced
from harness.reference.displaced import cube_sphere, mesh_file, normal_error, write_ply
from harness.reference.prepare import instantiate
from harness.scene import load_scene
from harness.scene.displaced import normal, radius
from harness.scene.model import Displacement, Procedural, as_matrix

GENTLE = Displacement(Procedural("fractal", ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), octaves=2, lacunarity=2.0, gain=0.5,
                                 frequency=1.5, distortion=0.0, seed=7, to_texture=as_matrix(np.eye(4))), 0.3)

SCENE = """<scene version="3.0.0">
<integrator type="path"><integer name="max_depth" value="4"/></integrator>
<sensor type="perspective"><float name="fov" value="32"/>
    <transform name="to_world"><lookat origin="0, 1, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="32"/><rfilter type="box"/>
    </film></sensor>
<emitter type="constant"/>
<shape type="displacedsphere"><float name="amplitude" value="0.3"/>{inner}
    <texture type="fractal" name="displacement"><float name="frequency" value="1.5"/><integer name="octaves" value="2"/>
    </texture>
</shape></scene>"""


def write(folder: Path, inner: str = "") -> Path:
    """A scene of one displaced sphere under a white sky."""
    path = folder / "displaced.xml"
    path.write_text(SCENE.format(inner=inner), encoding="utf-8")
    return path


def test_the_cube_sphere_is_closed_and_faces_outwards() -> None:
    """Each edge belongs to two triangles, which run along it in opposite ways; volumes with the centre are positive."""
    places, triangles = cube_sphere(6)
    edges = np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    forth, back = ({tuple(edge) for edge in ends.tolist()} for ends in (edges, edges[:, ::-1]))
    assert len(forth) == len(edges) and forth == back
    assert len(places) - len(edges) // 2 + len(triangles) == 2  # Euler's formula
    corners = places[triangles] / 3 - 1
    assert (np.linalg.det(corners) > 0).all()


@pytest.mark.parametrize("inner", [
    "", '<boolean name="flip_normals" value="true"/>', '<transform name="to_world"><scale x="-1"/></transform>',
    '<transform name="to_world"><scale value="0.8"/><rotate y="1" angle="30"/><translate x="0.3"/></transform>',
])
def test_mitsuba_meets_the_surface_and_its_normals(mi: Any, tmp_path: Path, inner: str) -> None:
    """Rays from outside: Mitsuba's hits and shading normals on the mesh against the exact surface."""
    scene = load_scene(write(tmp_path, inner))
    shape = scene.shapes[0]
    assert shape.displacement is not None
    e = np.random.default_rng(2).normal(size=(2000, 3))
    e /= np.linalg.norm(e, axis=1, keepdims=True)
    o, d = shape.matrix[:3, 3] + 3 * e, -e
    si = instantiate(scene.file).ray_intersect(mi.Ray3f(mi.Point3f(o.T), mi.Vector3f(d.T)))
    p, shading, geometric = (np.array(v).T for v in (si.p, si.sh_frame.n, si.n))
    local = np.c_[p, np.ones(len(p))] @ np.linalg.inv(shape.matrix).T[:, :3]
    directions = local / np.linalg.norm(local, axis=1, keepdims=True)
    r, gradient = radius(shape.displacement, directions)
    outward = normal(directions, r, gradient) @ np.linalg.inv(shape.matrix)[:3, :3]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True) * (-1 if shape.flip_normals else 1)
    assert np.abs(np.linalg.norm(local, axis=1) - r).max() < 4e-4
    assert np.sqrt(((shading - outward)**2).sum(axis=1).mean()) < 5e-3
    assert ((geometric * outward).sum(axis=1) > 0.9).all()


def test_errors_fall_with_the_square_of_the_edges() -> None:
    coarse, fine = normal_error(GENTLE, 64), normal_error(GENTLE, 128)
    assert 3.5 < coarse / fine < 4.5


def test_a_mesh_is_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path))
    path = mesh_file(GENTLE, mirrored=False)
    before = path.stat().st_ino
    assert mesh_file(GENTLE, mirrored=False) == path and path.stat().st_ino == before
    assert mesh_file(GENTLE, mirrored=True) != path
    assert [entry.name for entry in path.parent.iterdir() if entry.name.startswith(".")] == []


def test_old_meshes_make_room_for_new_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those unused for longest go first, and none that Mitsuba may be about to read."""
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path))
    monkeypatch.setattr(displaced, "LIMIT", 5_000_000)
    first = mesh_file(GENTLE, mirrored=False)
    oldest, old, recent = (first.with_name(f"{name}.ply") for name in ("oldest", "old", "recent"))
    for path, hours in ((oldest, 9), (old, 5), (recent, 0)):
        path.write_bytes(bytes(1000))
        used = time.time() - 3600 * hours
        os.utime(path, (used, used))
    os.utime(first, (time.time() - 3600 * 7,) * 2)
    mesh_file(GENTLE, mirrored=False)
    second = mesh_file(GENTLE, mirrored=True)
    assert first.stat().st_size == second.stat().st_size > 4_900_000, "two of them are beyond the limit"
    assert set(first.parent.iterdir()) == {first, second, recent}, "the first was used a moment ago"
    os.utime(first, (time.time() - 3600 * 7,) * 2)
    second.unlink()
    mesh_file(GENTLE, mirrored=True)
    assert set(first.parent.iterdir()) == {second, recent}


def test_a_cache_that_cannot_be_written_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "file"))
    with pytest.raises(StoreError, match="is not a folder"):
        mesh_file(GENTLE, mirrored=False)


def test_a_mesh_is_as_large_as_its_header_says(tmp_path: Path) -> None:
    write_ply(tmp_path / "mesh.ply", GENTLE, 4)
    data = (tmp_path / "mesh.ply").read_bytes()
    vertices, triangles = 6 * 4**2 + 2, 6 * 4**2 * 2
    assert f"element vertex {vertices}\n".encode() in data and f"element face {triangles}\n".encode() in data
    assert len(data) == data.index(b"end_header\n") + len(b"end_header\n") + vertices * 24 + triangles * 13


def test_both_renderers_agree(tmp_path: Path) -> None:
    """Textured in object space, mirrored and placed: what could be lost on the way to the mesh."""
    inner = """<transform name="to_world"><scale x="-1"/><rotate z="1" angle="20"/></transform>
        <bsdf type="phong"><texture type="fractal" name="kd"><float name="frequency" value="3"/></texture>
        <float name="ks" value="0.4"/></bsdf>"""
    scene = load_scene(write(tmp_path, inner))
    verdict = judge(render(scene, spp=512), render_reference(scene, 512), tolerance=0.005)
    assert verdict.outcome == "pass", verdict.reason
