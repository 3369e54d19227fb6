"""Motion in the reference: times that batches and replicas may rest on, and shapes moved to where they belong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.files import data_dir
from harness.reference import ReferenceRenderer
from harness.reference.motion import SAMPLES_PER_MOMENT, moment, moments, radical_inverse, samples_per_moment
from harness.reference.prepare import instantiate
from harness.samples.estimate import Batch, merge
from harness.scene import Scene, load_scene
from harness.scene.motion import moving

MOTION = """<transform name="motion"><translate x="-0.2"/><rotate x="0.6" z="0.8" angle="100"/>
    <translate x="0.4" y="0.3"/></transform>"""
BSDFS = {
    "bitmap-like": '<bsdf type="diffuse"><texture type="checkerboard" name="reflectance"><transform name="to_uv">'
                   '<scale value="4"/></transform></texture></bsdf>',
    "object space": '<bsdf type="twosided"><bsdf type="diffuse"><texture type="marble" name="reflectance">'
                    '<rgb name="color0" value="0.1, 0.2, 0.3"/><rgb name="color1" value="0.9, 0.8, 0.2"/></texture>'
                    '</bsdf></bsdf>',
}


def write(path: Path, body: str, shutter: tuple[float, float]) -> Scene:
    """A scene file around shapes, loaded."""
    path.write_text(f"""<scene version="3.0.0">
        <integrator type="path"><integer name="max_depth" value="2"/></integrator>
        <sensor type="perspective"><transform name="to_world">
            <lookat origin="0,0,6" target="0,0,0" up="0,1,0"/></transform>
            <float name="shutter_open" value="{shutter[0]}"/><float name="shutter_close" value="{shutter[1]}"/>
            <film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="24"/>
            <rfilter type="box"/></film></sensor>
        <emitter type="constant"><float name="radiance" value="1"/></emitter>{body}</scene>""")
    return load_scene(path)


def shape(kind: str, bsdf: str, mirrored: bool) -> str:
    """A shape with a motion; mirrored ones face inwards or away without `flip_normals`, which is set for them."""
    return f"""<shape type="{kind}"><transform name="to_world"><scale x="{-0.8 if mirrored else 0.8}" y="0.8" z="0.8"/>
        <rotate y="1" angle="20"/><translate x="0.3" y="0.2"/></transform>{MOTION}
        <boolean name="flip_normals" value="{str(mirrored).lower()}"/>{BSDFS[bsdf]}</shape>"""


def seen(mi: Any, scene: Any) -> np.ndarray:
    """What 2000 rays meet: distance, normals of surface and shading, uv, and the reflectance there, (2000, 12)."""
    rng = np.random.default_rng(4)
    o = rng.normal(size=(3, 2000)) * 3
    d = rng.uniform(-1, 1, (3, 2000)) - o
    d /= np.linalg.norm(d, axis=0)
    si = scene.ray_intersect(mi.Ray3f(mi.Point3f(np.float32(o)), mi.Vector3f(np.float32(d))))
    si.wi = mi.Vector3f(0, 0, 1)
    values = [si.t, *si.n, *si.sh_frame.n, *si.uv, *si.bsdf().eval_diffuse_reflectance(si, si.is_valid())]
    return np.stack([np.array(value, dtype=np.float64) for value in values], axis=1)


@pytest.mark.parametrize("bsdf", BSDFS)
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("kind", ["sphere", "rectangle", "disk", "cube", "cylinder"])
def test_moved_shapes_are_those_of_a_scene_in_that_pose(mi: Any, tmp_path: Path, kind: str, mirrored: bool,
                                                        bsdf: str) -> None:
    """After several moves: what rays meet, its normals, coordinates and textures, against a file of that moment."""
    body = shape(kind, bsdf, mirrored)
    renderer = ReferenceRenderer(write(tmp_path / "moving.xml", body, (0, 1)).file)
    assert renderer._moving_shapes is not None
    for time in (0.9, 0.3, 0.7):
        renderer._moving_shapes.move(time)
    still = write(tmp_path / "still.xml", body, (0.7, 0.7))
    assert not moving(still)
    found, expected = seen(mi, renderer._mitsuba_scene), seen(mi, instantiate(still.file))
    both = np.isfinite(found[:, 0]) & np.isfinite(expected[:, 0])
    assert both.sum() > 150
    assert (np.isfinite(found[:, 0]) == np.isfinite(expected[:, 0])).mean() > 0.998
    difference = np.abs(found[both] - expected[both])
    difference[:, 7:9] = np.minimum(difference[:, 7:9], 1 - difference[:, 7:9])  # coordinates wrap round
    # All but where rounding decides: at edges of faces and squares, seams and poles.
    assert (np.quantile(difference, 0.98, axis=0) < 1e-4).all(), np.quantile(difference, 0.98, axis=0)
    assert np.ptp(expected[both, 9]) > 0.1, "the texture shows"


def test_a_moment_is_rendered_as_a_scene_at_rest(mi: Any, tmp_path: Path) -> None:
    """A shutter of no length needs no moving: its calls are those of any other scene."""
    renderer = ReferenceRenderer(write(tmp_path / "still.xml", shape("cube", "bitmap-like", False), (0.7, 0.7)).file)
    assert renderer._moving_shapes is None
    assert renderer._pieces(0, 300) == [(0, 256), (256, 44)]


def test_times_of_a_batch_are_spread_evenly() -> None:
    """The u of 32 moments from a multiple of 32 lie one in each 32nd, whatever the shift; so of any power of two."""
    for count in (2, 32, 128):
        for first in (0, count, 5 * count):
            u = np.array([radical_inverse(first + k) for k in range(count)])
            assert sorted(np.floor(u * count).astype(int)) == list(range(count))
            np.testing.assert_allclose(np.diff(np.sort(u)), 1 / count)
    assert [radical_inverse(k) for k in range(5)] == [0, 0.5, 0.25, 0.75, 0.125]


def test_times_are_uniform_over_the_interval() -> None:
    """For one sample over replicas, so that any batch is unbiased, and for one replica over samples."""
    over_replicas = [moment((2, 4), replica, 5 * SAMPLES_PER_MOMENT, SAMPLES_PER_MOMENT) for replica in range(1000)]
    over_samples = [moment((2, 4), 3, k * SAMPLES_PER_MOMENT, SAMPLES_PER_MOMENT) for k in range(1024)]
    for times, tolerance in ((over_replicas, 0.05), (over_samples, 0.002)):
        assert min(times) >= 2 and max(times) <= 4
        error = np.abs(np.sort(times) - np.linspace(2, 4, len(times), endpoint=False))
        assert error.max() < 2 * tolerance, "Kolmogorov's distance"


def test_replicas_have_times_of_their_own() -> None:
    """Shifts of replicas are uncorrelated, and the same again for the same replica."""
    shifts = [moment((0, 1), replica, 0, 4) for replica in range(1000)]
    assert len(set(shifts)) == 1000 and shifts[7] == moment((0, 1), 7, 0, 4)
    assert abs(np.corrcoef(shifts[:-1], shifts[1:])[0, 1]) < 4 / np.sqrt(999)


def test_a_mesh_is_moved_less_often(mi: Any, tmp_path: Path) -> None:
    """Building its search structure again takes seconds; analytic shapes and meshes at rest take none."""
    displaced = """<shape type="displacedsphere"><float name="amplitude" value="0.1"/>
        <texture name="displacement" type="fractal"/>{}</shape>"""
    for mesh, ball, expected in (("", MOTION, 4), (MOTION, "", 32), (MOTION, MOTION, 32)):
        body = f'{displaced.format(mesh)}<shape type="sphere">{ball}</shape>'
        assert samples_per_moment(write(tmp_path / "scene.xml", body, (0, 1))) == expected


@pytest.mark.parametrize(("first", "count", "largest", "expected"), [
    (0, 1, 256, [(0, 1)]), (1, 1, 256, [(1, 1)]), (2, 2, 256, [(2, 2)]), (4, 8, 256, [(4, 4), (8, 4)]),
    (3, 6, 256, [(3, 1), (4, 4), (8, 1)]), (0, 5, 2, [(0, 2), (2, 2), (4, 1)]),
])
def test_ranges_are_cut_at_moments(first: int, count: int, largest: int, expected: list[tuple[int, int]]) -> None:
    """Each call sees one moment, and is no longer than calls may be."""
    assert moments(first, count, 4, largest) == expected


def test_a_range_may_be_cut_at_any_moment(mi: Any) -> None:
    """One batch equals the same range in separate batches, and again from another renderer object."""
    scene = load_scene(data_dir("mitsuba_scenes") / "motion_blur.xml", width=8, height=6)
    renderer = ReferenceRenderer(scene.file)
    whole = renderer.render_batch(1, 0, 24)
    parts = merge(renderer.render_batch(1, start, count) for start, count in ((0, 8), (8, 16)))
    np.testing.assert_allclose(whole.mean, parts.mean, rtol=1e-6)
    np.testing.assert_array_equal(ReferenceRenderer(scene.file).render_batch(1, 0, 24).mean, whole.mean)


def disk_passing(time: float) -> np.ndarray:
    """What a pixel grid sees of a disk of radius 0.2 at x = 2 `time` - 1, (16, 64): 1 inside, 0 outside."""
    y, x = np.mgrid[-0.25:0.25:16j, -1:1:64j]
    return np.hypot(x - (2 * time - 1), y) < 0.2


@pytest.mark.parametrize("samples", [64, 512])
def test_variance_by_batch_means_is_not_too_small(samples: int) -> None:
    """Batches of a replica share its shift; yet their variance is no less than that between replicas.

    A disk that enters and leaves the view, free of all other noise: in the image's mean, and in its pixels.
    """
    size = samples // 8
    means, image_variances, pixel_variances = [], [], []
    for replica in range(48):
        batches = []
        for start in range(0, samples, size):
            times = [moment((-0.1, 1), replica, k, 4) for k in range(start, start + size, 4)]
            mean = np.mean([disk_passing(time) for time in times], axis=0)
            batches.append(Batch(np.repeat(mean[..., None], 3, axis=-1), size))
        merged = merge(batches)
        means.append(merged.mean[..., 0])
        image_variances.append(merged.image_variance[0])
        pixel_variances.append(merged.variance[..., 0])
    between_images = np.var([mean.mean() for mean in means], ddof=1)
    between_pixels = np.var(means, axis=0, ddof=1).mean()
    assert 0 < between_images < np.mean(image_variances)
    assert 0 < between_pixels < np.mean(pixel_variances)
