"""Scenes whose answer is known by a formula: no reference renderer, and so none of its errors."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from harness.gpu.renderer import TracerRenderer
from harness.samples.estimate import Batch, Estimate, merge
from harness.scene import Camera, Material, Scene, Shape, load_scene
from harness.scene.model import RGB, Checkerboard, Procedural, Varying
from harness.scene.strategies import STRATEGIES, check_strategy

SCENES = Path(__file__).parents[2] / "mitsuba_scenes"
BATCHES = 16
# All comparisons of this file together raise a false alarm in one of a thousand changes of the seeds.
COMPARISONS = 150
LIMIT = stats.t.isf(1e-3 / (2 * COMPARISONS), BATCHES - 1)
# Of an answer without variance: what float32 sums of up to 512 samples may lose (gpu.pingpong.FLUSH_SAMPLES).
EXACT = 1e-5
IDENTITY = tuple(map(tuple, np.eye(4).tolist()))
NO_LIGHT = (0.0, 0.0, 0.0)


@functools.cache
def batches(scene: Scene, strategy: str, spp: int) -> tuple[Batch, ...]:
    """BATCHES batches of `spp` samples per pixel."""
    renderer = TracerRenderer(scene, strategy)
    try:
        return tuple(renderer.render_batch(0, k * spp, spp) for k in range(BATCHES))
    finally:
        renderer.release()


def estimate(scene: Scene, strategy: str, spp: int, mask: np.ndarray) -> Estimate:
    """The merged estimate of the pixels in `mask`, (H, W) bool; fails where a sample was not finite."""
    merged = merge(dataclasses.replace(b, mean=b.mean[mask][None]) for b in batches(scene, strategy, spp))
    assert merged.rejected == 0
    return merged


def assert_answer(found: Estimate, exact: np.ndarray, resolution: float) -> None:
    """The mean over all pixels is the answer within its standard error by batch means, which is fine enough.

    `resolution`: the largest relative standard error at which the comparison still means something.
    """
    error = np.sqrt(found.image_variance[:3])
    assert (error <= resolution * exact + 1e-12).all(), f"relative standard error {error / exact}"
    difference = np.abs(found.image_mean[:3] - exact)
    assert (difference <= LIMIT * error + EXACT * exact).all(), f"{found.image_mean[:3]} instead of {exact}"


def film_plane(scene: Scene) -> tuple[np.ndarray, np.ndarray, float]:
    """x to the right and y upwards at distance 1 of the pixels' centres, (H, W) both, and half a pixel's diagonal."""
    tan_x, tan_y = scene.camera.tan_x, scene.camera.tan_y
    x = ((np.arange(scene.width) + 0.5) / scene.width * 2 - 1) * tan_x
    y = (1 - (np.arange(scene.height) + 0.5) / scene.height * 2) * tan_y
    return *np.meshgrid(x, y), float(np.hypot(tan_x / scene.width, tan_y / scene.height))


CONVEX = load_scene(SCENES / "furnace_convex.xml", width=40, height=40)


@pytest.mark.parametrize(("strategy", "resolution"), [("uniform", 6e-4), ("cosine", 1e-7), ("lobes", 1e-7),
                                                      ("mixture", 1e-7)])
def test_a_convex_body_shows_its_albedo(strategy: str, resolution: float) -> None:
    """furnace_convex: every pixel wholly on the sphere is its albedo, every pixel beside it the sky.

    Cosine sampling, and those that reduce to it where there is no lobe, have no variance: each pixel is exact.
    """
    x, y, half = film_plane(CONVEX)
    silhouette = 1 / np.sqrt(15)  # tangent of the sphere's angular radius: radius 1 seen from distance 4
    radius = np.hypot(x, y)
    inside, outside = radius < silhouette - half, radius > silhouette + half
    assert inside.sum() > 400 and outside.sum() > 400
    albedo = np.array([0.8, 0.5, 0.2])
    assert_answer(estimate(CONVEX, strategy, 256, inside), albedo, resolution)
    beside = estimate(CONVEX, strategy, 256, outside)
    np.testing.assert_allclose(beside.mean, 1, rtol=EXACT)
    if resolution < 1e-6:
        pixels = estimate(CONVEX, strategy, 256, inside).mean
        np.testing.assert_allclose(pixels, np.broadcast_to(albedo, pixels.shape), rtol=EXACT)


CUBE = load_scene(SCENES / "furnace_cube.xml", width=24, height=24)


def cube_answer(max_depth: int) -> np.ndarray:
    """E (1 + ρ + … + ρ^(N-1)) for N path vertices, (3,)."""
    emission, albedo = np.array([0.2, 0.4, 0.6]), np.array([0.8, 0.5, 0.3])
    return emission * sum(albedo**k for k in range(max_depth))


@pytest.mark.parametrize("max_depth", [1, 2, 3, 8, 40])
def test_a_closed_furnace_is_a_geometric_series(max_depth: int) -> None:
    """furnace_cube with cosine sampling: no variance, so pixels are the series, whatever the depth.

    A bounce too many or too few changes a term; a path that hits the wall that it starts from changes a pixel. So does
    one that begins within rounding of an edge and leaks: about one bounce in ten million, hence not quite all pixels.
    """
    scene = dataclasses.replace(CUBE, max_depth=max_depth)
    found, exact = estimate(scene, "cosine", 64, np.ones((24, 24), dtype=bool)), cube_answer(max_depth)
    assert (np.abs(found.mean / exact - 1) < EXACT).mean() > 0.99
    np.testing.assert_allclose(found.image_mean[:3], exact, rtol=EXACT)


def test_a_closed_furnace_with_uniform_sampling() -> None:
    """The same answer from weights 2 cos θ, multiplied along eight vertices."""
    assert_answer(estimate(CUBE, "uniform", 512, np.ones((24, 24), dtype=bool)), cube_answer(8), 1e-3)


def constant_textures(color: RGB) -> list[Varying]:
    """Textures of one colour in each of their parts."""
    turned = ((0.0, 2.0, 0.1), (-3.0, 0.0, 0.2), (0.0, 0.0, 1.0))
    return [Checkerboard(color, color, turned),
            Procedural("marble", (color, color, color), 3, 2.0, 0.5, 2.0, 1.0, 7, IDENTITY)]


@pytest.mark.parametrize("number", [0, 1], ids=["checkerboard", "marble"])
def test_a_closed_furnace_with_textures_of_one_colour(number: int) -> None:
    """furnace_cube again: where a texture has one value, albedo and light are as if they were constants."""
    walls = CUBE.shapes[0]
    albedo, emission = walls.material.kd, walls.emission
    assert isinstance(albedo, tuple) and isinstance(emission, tuple)
    material = dataclasses.replace(walls.material, kd=constant_textures(albedo)[number])
    textured = dataclasses.replace(walls, material=material, emission=constant_textures(emission)[number])
    scene = dataclasses.replace(CUBE, shapes=(textured,))
    found = estimate(scene, "cosine", 64, np.ones((24, 24), dtype=bool))
    np.testing.assert_allclose(found.image_mean[:3], cube_answer(8), rtol=EXACT)


PLATES = load_scene(SCENES / "furnace_phong.xml", width=40, height=40)
# Glossy plates with a diffuse term beneath: the strategies choose between two terms.
COATED = dataclasses.replace(PLATES, shapes=tuple(
    dataclasses.replace(shape, material=dataclasses.replace(shape.material, kd=(0.1, 0.3, 0.5), ks=(0.4, 0.4, 0.4)))
    for shape in PLATES.shapes))
# Relative standard errors per strategy for exponents 1, 10, 100, 300: uniform sampling seldom finds a narrow lobe.
RESOLUTION = {"uniform": (1e-3, 3e-3, 0.01, 0.04), "cosine": (1e-3, 2e-3, 0.01, 0.03), "phong": (1e-3,) * 4,
              "lobes": (2e-3,) * 4, "mixture": (2e-3,) * 4, "nee": (1e-3, 2e-3, 0.01, 0.03), "mis": (2e-3,) * 4}


@pytest.mark.parametrize(("scene", "strategy"), [
    *(("plates", strategy) for strategy in STRATEGIES),
    *(("coated", strategy) for strategy in STRATEGIES if strategy != "phong"),
])
def test_a_lobe_at_normal_incidence_reflects_its_albedo(scene: str, strategy: str) -> None:
    """furnace_phong: kd + ks (α+1)/(α+2) on plates of exponents 1, 10, 100, 300.

    The handout's π² for 2π in the pdf would show as +57 %, one power of α too many as a factor of α.
    """
    plates = {"plates": PLATES, "coated": COATED}[scene]
    assert check_strategy(plates, strategy).suits
    x, y, half = film_plane(plates)
    margin = 400 * half
    for shape, resolution in zip(plates.shapes, RESOLUTION[strategy], strict=True):
        centre_x, centre_y, material = shape.matrix[0, 3], shape.matrix[1, 3], shape.material
        on_plate = (np.abs(400 * x - centre_x) < 1 - margin) & (np.abs(400 * y - centre_y) < 1 - margin)
        assert on_plate.sum() > 200
        exact = np.array(material.kd) + np.array(material.ks) * (material.alpha + 1) / (material.alpha + 2)
        assert_answer(estimate(plates, strategy, 256, on_plate), exact, resolution)


WHITE = Material((1.0, 1.0, 1.0), NO_LIGHT, 1.0)
GREY = Material((0.5, 0.25, 0.75), NO_LIGHT, 1.0)
# Looks along +z at a wall that fills the view, lit by a sky of radiance 1.
WALL = Scene((), (1.0, 1.0, 1.0), Camera(IDENTITY, 0.2, 0.2, 0.01, 1e4), 4, 4, max_depth=3)
AT_5 = ((10.0, 0.0, 0.0, 0.0), (0.0, 10.0, 0.0, 0.0), (0.0, 0.0, 1.0, 5.0), (0.0, 0.0, 0.0, 1.0))


@pytest.mark.parametrize("kind", ["rectangle", "disk"])
@pytest.mark.parametrize(("change", "expected"), [
    (lambda front: front, (0.5, 0.25, 0.75)),
    (lambda front: dataclasses.replace(front, flip_normals=False), NO_LIGHT),
    (lambda front: dataclasses.replace(front, flip_normals=False, material=dataclasses.replace(GREY, two_sided=True)),
     (0.5, 0.25, 0.75)),
    (lambda front: dataclasses.replace(front, emission=(2.0, 3.0, 4.0)), (2.5, 3.25, 4.75)),
    (lambda front: dataclasses.replace(front, emission=(2.0, 3.0, 4.0), flip_normals=False), NO_LIGHT),
    (lambda front: dataclasses.replace(front, emission=(2.0, 3.0, 4.0), flip_normals=False,
                                       material=dataclasses.replace(GREY, two_sided=True)), (0.5, 0.25, 0.75)),
], ids=["front", "back", "back two-sided", "emissive front", "emissive back", "emissive two-sided back"])
def test_sides(kind: str, change: Callable[[Shape], Shape], expected: tuple[float, float, float]) -> None:
    """Fronts reflect, backs are black unless two-sided, and light leaves the front only, two-sided or not."""
    front = Shape(kind, AT_5, GREY, flip_normals=True)  # type: ignore[arg-type]  # one of the shapes
    scene = dataclasses.replace(WALL, shapes=(change(front),))
    pixels = estimate(scene, "cosine", 16, np.ones((4, 4), dtype=bool)).mean
    np.testing.assert_allclose(pixels, np.broadcast_to(expected, pixels.shape), rtol=EXACT)


def test_a_two_sided_shape_leaves_its_neighbours_one_sided() -> None:
    """Two backs side by side, +x on the left: the two-sided one reflects, the other stays black."""
    left = np.array(AT_5)
    left[0, 3] = 10.0
    right = left * np.array([[-1.0], [1.0], [1.0], [1.0]])  # mirrored about x = 0, which leaves a plane's front
    two_sided = Shape("rectangle", tuple(map(tuple, left.tolist())), dataclasses.replace(GREY, two_sided=True))
    one_sided = Shape("rectangle", tuple(map(tuple, right.tolist())), GREY)
    scene = dataclasses.replace(WALL, shapes=(two_sided, one_sided))
    pixels = estimate(scene, "cosine", 16, np.ones((4, 4), dtype=bool)).mean.reshape(4, 4, 3)
    np.testing.assert_allclose(pixels[:, :2], np.broadcast_to(GREY.kd, (4, 2, 3)), rtol=EXACT)
    np.testing.assert_array_equal(pixels[:, 2:], 0)


def test_clip_planes_cut_camera_rays_only() -> None:
    """Two white walls face each other at distance 1, and the camera's planes lie close about the farther one.

    The nearer wall, before the near plane, is not seen; but scattered rays reach it, although it is farther off than
    the planes are apart, and it emits. With the farther wall beyond the far plane nothing is seen at all.
    """
    near_wall = Shape("rectangle", (AT_5[0], AT_5[1], (0.0, 0.0, 1.0, 4.0), AT_5[3]), WHITE, emission=(1.0, 1.0, 1.0))
    far_wall = Shape("rectangle", AT_5, WHITE, flip_normals=True)
    camera = dataclasses.replace(WALL.camera, near_clip=4.5, far_clip=5.2)
    scene = dataclasses.replace(WALL, shapes=(near_wall, far_wall), environment=NO_LIGHT, camera=camera, max_depth=2)
    everything = np.ones((4, 4), dtype=bool)
    # Squares of side 20 at distance 1: seen from the middle of one, the other covers all but 1 % of the cosine.
    assert 0.97 < estimate(scene, "cosine", 64, everything).image_mean[0] < 1
    too_near = dataclasses.replace(scene, camera=dataclasses.replace(camera, near_clip=4.5, far_clip=4.9))
    assert estimate(too_near, "cosine", 64, everything).image_mean[0] == 0
