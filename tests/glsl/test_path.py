"""What a sample of the whole tracer draws: place in the pixel, moment, lens point, read off a wall that tells them.

Probes evaluate functions; whether `trace_samples` gives them the right random numbers shows in samples alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from harness.scene import Scene
from tests.support.scenes import SceneWriter
from tests.support.tracer import TracerRenderer

PIXELS = 32  # of the film, a side
TEXELS = 1024  # of the wall, a side: it fills the film twice, so that a pixel is 16 texels wide
SAMPLES = 16  # per pixel
LEVEL = 1e-3  # of a test that holds; what it is there for fails far below


@pytest.fixture
def wall(mi: Any, scene: SceneWriter, tmp_path: Path) -> Any:
    """Writes a scene of a glowing wall, as wide as two films and parallel to the film, that moves by `motion`.

    Its red is u and its green v of the point that a ray meets. `sensor`: the camera's plugin, and properties of it.
    """
    def write(motion: str = "", sensor: tuple[str, str] = ("perspective", "")) -> Scene:
        ramp = (np.arange(TEXELS, dtype=np.float32) + 0.5) / TEXELS
        texels = np.stack([*np.meshgrid(ramp, ramp[::-1]), np.ones((TEXELS, TEXELS), np.float32)], axis=-1)
        mi.Bitmap(texels).write(str(tmp_path / "ramp.exr"))
        moves = f'<transform name="motion">{motion}</transform>' if motion else ""
        return scene(
            f"""<shape type="rectangle"><transform name="to_world"><scale value="2"/><rotate y="1" angle="180"/>
            <translate z="1"/></transform>{moves}<emitter type="area"><texture name="radiance" type="bitmap">
            <string name="filename" value="ramp.exr"/><boolean name="raw" value="true"/>
            <string name="filter_type" value="nearest"/></texture></emitter></shape>""",
            sensor=f"""<sensor type="{sensor[0]}">{sensor[1]}<float name="fov" value="90"/>
            <float name="shutter_open" value="0"/><float name="shutter_close" value="1"/><film type="hdrfilm">
            <integer name="width" value="{PIXELS}"/><integer name="height" value="{PIXELS}"/><rfilter type="box"/>
            </film></sensor>""")
    return write


def samples(scene: Scene) -> np.ndarray:
    """(SAMPLES, PIXELS, PIXELS, 2): u and v of single samples, in pixels from the film's first, along x and y."""
    renderer = TracerRenderer(scene, "uniform")
    try:
        found = np.stack([renderer.render_batch(0, start, 1).mean for start in range(SAMPLES)]).astype(np.float64)
    finally:
        renderer.release()
    assert (found[..., 2] == 1).all(), "a ray that does not meet the wall"
    return np.stack([found[..., 0] * 2 * PIXELS - PIXELS / 2, found[..., 1] * 2 * PIXELS - PIXELS / 2], axis=-1)


def test_samples_fill_their_pixel_evenly(wall: Any) -> None:
    """Each lies in its own pixel, and all together are uniform over 8 x 8 cells of it: chi²."""
    rows, columns = np.indices((PIXELS, PIXELS))
    place = samples(wall()) - np.stack([columns, rows], axis=-1)
    texel = 2 * PIXELS / TEXELS
    assert place.min() > -texel and place.max() < 1 + texel
    cells = np.clip((place * 8).astype(int), 0, 7).reshape(-1, 2)
    assert stats.chisquare(np.bincount(cells[:, 0] * 8 + cells[:, 1], minlength=64)).pvalue > LEVEL


def test_samples_are_spread_evenly_over_the_shutters_interval(wall: Any) -> None:
    """A wall that moves by half a film tells the moment, to the place in the pixel: chi² of 16 times.

    The place blurs moments by half a pixel to both sides, which changes no count but at both ends; there the counts
    stay right if what lies beyond the end is taken in.
    """
    moved = samples(wall(motion='<translate x="1"/>'))[..., 0] - (np.arange(PIXELS) + 0.5)
    moments = np.abs(moved) / (PIXELS / 2) * np.sign(moved * np.sign(np.median(moved)))
    counts = np.bincount(np.clip((moments * 16).astype(int), 0, 15).ravel(), minlength=16)
    assert stats.chisquare(counts).pvalue > LEVEL


def test_the_moment_does_not_follow_the_place(wall: Any) -> None:
    """A wall that moves upwards: the place along x and the moment are independent, in 8 x 8 cells."""
    found = samples(wall(motion='<translate y="1"/>'))
    across = np.clip(((found[..., 0] - np.arange(PIXELS)) * 8).astype(int), 0, 7)
    along = np.abs(found[..., 1] - np.arange(PIXELS)[:, None] - 0.5) / (PIXELS / 2)
    table = np.zeros((8, 8), int)
    np.add.at(table, (across.ravel(), np.clip((along * 8).astype(int), 0, 7).ravel()), 1)
    assert stats.chi2_contingency(table).pvalue > LEVEL


def test_the_lens_point_is_even_and_does_not_follow_the_place(wall: Any) -> None:
    """A wall out of focus: places shifted by lens points, as NumPy draws them. Kolmogorov and Smirnov, two samples.

    Of a disk of half a pixel's radius, so that either share of the sum shows; both coordinates, and both diagonals,
    which tell points on a curve from a disk.
    """
    radius, focus = 2 / PIXELS, 2.0  # the wall, at distance 1, is as wide as two films; half of the radius is left
    lens = f'<float name="aperture_radius" value="{radius}"/><float name="focus_distance" value="{focus}"/>'
    rows, columns = np.indices((PIXELS, PIXELS))
    found = (samples(wall(sensor=("thinlens", lens))) - np.stack([columns, rows], axis=-1)).reshape(-1, 2)
    rng = np.random.default_rng(1)
    place, (r2, turn) = rng.random((len(found), 2)), rng.random((2, len(found)))
    disk = np.sqrt(r2)[:, None] * np.stack([np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)], axis=-1)
    expected = place + 0.5 * disk
    expected = (np.floor(expected * TEXELS / PIXELS / 2) + 0.5) * 2 * PIXELS / TEXELS
    for axis in ([1, 0], [0, 1], [1, 1], [1, -1]):
        assert stats.ks_2samp(found @ axis, expected @ axis).pvalue > LEVEL
