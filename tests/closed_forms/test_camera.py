"""Depth of field and motion blur against formulas: what a lens and a shutter make of a bright shape before black.

Every sample is 1 where its ray meets the shape and 0 where it does not, so a pixel of N independent samples has exactly
the binomial distribution, and the image is compared with its formula pixel by pixel, by chi².
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from harness.gpu.renderer import TracerRenderer
from harness.reference import ReferenceRenderer
from harness.samples.estimate import Estimate, merge
from harness.scene import Scene, load_scene

SIZE = 24  # pixels a side
TAN = 0.5  # half the film's extent at distance 1
SUBPIXELS = 16  # a side, on which formulas are averaged over a pixel
SAMPLES, BATCHES = 2048, 16
LEVEL = 1e-3  # false alarms of each comparison; the seeds are fixed, so this asks how lucky they are, once
# Samples that a formula must expect of a pixel, hits and misses, for the normal law to hold.
ENOUGH = 10
Formula = Callable[[np.ndarray, np.ndarray], np.ndarray]  # of x (left) and y (up) at distance 1, to a fraction

LENS_RADIUS, FOCUS = 0.6, 4.0


def write(path: Path, sensor: str, properties: str, shape: str) -> Scene:
    """A bright shape seen from the origin along +z, without a path's second vertex."""
    path.write_text(f"""<scene version="3.0.0">
        <integrator type="path"><integer name="max_depth" value="1"/></integrator>
        <sensor type="{sensor}"><float name="fov" value="{2 * np.degrees(np.arctan(TAN))}"/>{properties}
        <film type="hdrfilm"><integer name="width" value="{SIZE}"/><integer name="height" value="{SIZE}"/>
        <rfilter type="box"/></film></sensor>{shape}</scene>""")
    return load_scene(path)


def emitter(kind: str, to_world: str, motion: str = "") -> str:
    """A flat shape that faces the camera, of radiance 1."""
    return f"""<shape type="{kind}"><transform name="to_world"><rotate y="1" angle="180"/>{to_world}</transform>{motion}
        <emitter type="area"><float name="radiance" value="1"/></emitter></shape>"""


def by_tracer(scene: Scene) -> Estimate:
    """SAMPLES samples a pixel."""
    renderer = TracerRenderer(scene, "cosine")
    try:
        return merge(renderer.render_batch(0, k * SAMPLES // BATCHES, SAMPLES // BATCHES) for k in range(BATCHES))
    finally:
        renderer.release()


def by_mitsuba(scene: Scene, samples: int = SAMPLES) -> Estimate:
    """The same of the reference."""
    renderer = ReferenceRenderer(scene.file)
    return merge(renderer.render_batch(0, k * samples // BATCHES, samples // BATCHES) for k in range(BATCHES))


def pixels(formula: Formula) -> np.ndarray:
    """The formula's mean over each pixel, (SIZE, SIZE), row 0 at the top, +x on the left."""
    edge = TAN * (1 - 2 * (np.arange(SIZE * SUBPIXELS) + 0.5) / (SIZE * SUBPIXELS))
    x, y = np.meshgrid(edge, edge)
    return formula(x, y).reshape(SIZE, SUBPIXELS, SIZE, SUBPIXELS).mean((1, 3))


def assert_binomial(found: Estimate, expected: np.ndarray) -> None:
    """Channel 0 of the image has the mean `expected` and its binomial variance, in the pixels that can tell."""
    telling = SAMPLES * expected * (1 - expected) > ENOUGH
    assert telling.sum() > 20
    z = (found.mean[..., 0] - expected)[telling] / np.sqrt((expected * (1 - expected))[telling] / SAMPLES)
    assert stats.chi2.sf((z**2).sum(), telling.sum()) > LEVEL, f"chi² of {(z**2).mean():.2f} a pixel"
    total = (found.mean[..., 0] - expected).sum() / np.sqrt((expected * (1 - expected)).sum() / SAMPLES)
    assert abs(total) < stats.norm.isf(LEVEL / 2), f"all light together is off by {total:.1f} standard errors"
    assert (found.mean[..., 0][expected == 0] == 0).all()


def overlap(distance: np.ndarray, a: float, b: float) -> np.ndarray:
    """The area that disks of radii a and b share when their centres are `distance` apart."""
    d = np.clip(distance, max(abs(a - b), 1e-12), a + b)
    first = a * a * np.arccos(np.clip((d * d + a * a - b * b) / (2 * d * a), -1, 1))
    second = b * b * np.arccos(np.clip((d * d + b * b - a * a) / (2 * d * b), -1, 1))
    kite = 0.5 * np.sqrt(np.maximum((a + b - d) * (d + a - b) * (d - a + b) * (d + a + b), 0))
    return np.where(distance < a + b, first + second - kite, 0)


def lens_image(depth: float, radius: float) -> Formula:
    """What a lens sees of a disk on the axis: the part of the lens from which the ray through f meets the disk.

    The ray from lens point ℓ to the point f in the plane of focus F crosses the disk's plane z at
    ℓ (1 - z/F) + f z/F. So it meets the disk where ℓ is within radius / |1 - z/F| of -f (z/F) / (1 - z/F): of the lens,
    the share that two disks overlap. For a small disk that is a constant within the circle of confusion,
    |f| < R |F/z - 1|.
    """
    spread = abs(1 - depth / FOCUS)

    def formula(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        distance = FOCUS * np.hypot(x, y) * depth / FOCUS / spread
        return overlap(distance, LENS_RADIUS, radius / spread) / (np.pi * LENS_RADIUS**2)
    return formula


@pytest.mark.parametrize("render", [by_tracer, by_mitsuba])
@pytest.mark.parametrize(("depth", "radius"), [(1.2, 0.04), (1.2, 0.15), (12.0, 0.2), (12.0, 1.5)])
def test_a_light_out_of_focus_is_its_circle_of_confusion(tmp_path: Path, render: Callable[[Scene], Estimate],
                                                         depth: float, radius: float) -> None:
    """Before and behind the plane of focus, small against the blur and not: radius, profile and energy."""
    scene = write(tmp_path / "lens.xml", "thinlens", f'<float name="aperture_radius" value="{LENS_RADIUS}"/>'
                  f'<float name="focus_distance" value="{FOCUS}"/>',
                  emitter("disk", f'<scale value="{radius}"/><translate z="{depth}"/>'))
    expected = pixels(lens_image(depth, radius))
    assert_binomial(render(scene), expected)
    blur = LENS_RADIUS * abs(1 / FOCUS - 1 / depth)  # the radius of the circle of confusion, at distance 1
    centres = ((np.arange(SIZE) + 0.5) / SIZE * 2 - 1) * TAN
    lit = np.hypot(*np.meshgrid(centres, centres))[expected > 0].max()
    assert lit == pytest.approx(blur + radius / depth, abs=2 * TAN / SIZE)
    assert expected.sum() * (2 * TAN / SIZE) ** 2 == pytest.approx(np.pi * (radius / depth) ** 2, rel=2e-3), "energy"


OPEN, CLOSE = 0.2, 1.4


def moving_disk(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The share of the time for which a disk of radius 0.4 at depth 4 is before a point.

    Its centre is at (-1.2 + 1.5 t, 0.3): it enters and leaves within the chord that the point's height cuts.
    """
    half = np.sqrt(np.maximum(0.4**2 - (4 * y - 0.3) ** 2, 0))
    enters, leaves = ((4 * x + 1.2 + side * half) / 1.5 for side in (-1, 1))
    return np.maximum(np.minimum(leaves, CLOSE) - np.maximum(enters, OPEN), 0) / (CLOSE - OPEN) * (half > 0)


def turning_rectangle(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The share of the time for which a rectangle, [0.1, 1.1] x [-0.2, 0.2] at rest, covers a point of its plane.

    It turns by 80 degrees in a unit of time about the point (0.3, 0) of the view: seen from the rectangle the point
    turns the other way, on a circle, along which the rectangle's sides cut arcs at angles known from their distances.
    """
    x, y = 4 * x - 0.3, 4 * y
    rho, phi = np.hypot(x, y), np.arctan2(y, x)
    first, last = (phi - np.radians(80) * time for time in (CLOSE, OPEN))
    cuts = [np.zeros_like(x), np.ones_like(x)]  # where an arc may begin or end, as parts of the way from first to last
    for side in (0.1, 1.1):
        angle = np.arccos(np.clip(side / rho, -1, 1))
        cuts += [((sign * angle - first) % (2 * np.pi)) / (last - first) for sign in (-1, 1)]
    for side in (-0.2, 0.2):
        angle = np.arcsin(np.clip(side / rho, -1, 1))
        cuts += [((a - first) % (2 * np.pi)) / (last - first) for a in (angle, np.pi - angle)]
    ordered = np.sort(np.clip(cuts, 0, 1), axis=0)
    middle = first + (last - first) * (ordered[1:] + ordered[:-1]) / 2
    u, v = rho * np.cos(middle), rho * np.sin(middle)
    inside = (u > 0.1) & (u < 1.1) & (np.abs(v) < 0.2)
    return (np.diff(ordered, axis=0) * inside).sum(axis=0)


MOVING = {
    "disk": (moving_disk, emitter("disk", '<scale value="0.4"/><translate x="-1.2" y="0.3" z="4"/>',
                                  '<transform name="motion"><translate x="1.5"/></transform>')),
    "rectangle": (turning_rectangle, emitter(
        "rectangle", '<scale x="0.5" y="0.2"/><translate x="0.9" z="4"/>',
        '<transform name="motion"><translate x="-0.3"/><rotate z="1" angle="80"/><translate x="0.3"/></transform>')),
}


def moving_scene(path: Path, case: str) -> Scene:
    """One of the moving shapes before an open shutter."""
    return write(path, "perspective", f'<float name="shutter_open" value="{OPEN}"/>'
                                      f'<float name="shutter_close" value="{CLOSE}"/>', MOVING[case][1])


@pytest.mark.parametrize("case", MOVING)
def test_a_moving_shape_covers_its_share_of_the_time(tmp_path: Path, case: str) -> None:
    """The tracer: independent times, so that coverage is binomial."""
    assert_binomial(by_tracer(moving_scene(tmp_path / "motion.xml", case)), pixels(MOVING[case][0]))


@pytest.mark.parametrize("case", MOVING)
def test_the_reference_covers_its_share_more_evenly(tmp_path: Path, case: str) -> None:
    """Stratified times: less noise than the binomial, which still counts the pixel's jitter, and no bias beside it."""
    samples = 512
    expected = pixels(MOVING[case][0])
    found = by_mitsuba(moving_scene(tmp_path / "motion.xml", case), samples)
    squares = (found.mean[..., 0] - expected) ** 2
    assert squares.mean() < 0.5 * (expected * (1 - expected) / samples).mean()
    assert squares.max() < 0.05**2
    error = found.image_mean[0] - expected.mean()
    assert abs(error) < stats.t.isf(LEVEL / 2, BATCHES - 1) * np.sqrt(found.image_variance[0])
    assert found.variance[..., 0].mean() > squares.mean(), "batch means do not understate it"
