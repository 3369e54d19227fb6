"""What directions are drawn from an environment map by: its integrals, its density, the table and what that means."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.files import data_dir
from harness.scene import load_scene
from harness.scene.bitmaps import environment_texels
from harness.scene.importance import (
    BINS,
    STRATA,
    Tables,
    bilinear,
    is_black,
    mean_radiance,
    pdf,
    runs,
    sampling_table,
    sweep,
    tables_of,
    tent_integrals,
    texel_density,
    whole_bins,
)
from harness.scene.model import EnvironmentMap
from harness.shader.scene.chunk import scene_chunk
from harness.shader.scene.environment import drawn_by, sampling_functions

# Points of Gauss and Legendre along each side of a texel's cell: exact to 1e-12 for the sines of cells so small.
GAUSS = 6


def one_texel(row: int, column: int) -> np.ndarray:
    texels = np.zeros((5, 8, 3))
    texels[row, column] = 1, 2, 3
    return texels


def noise(rows: int, columns: int, power: float = 1.0) -> np.ndarray:
    """Of a large range of brightness where `power` is large, and black in places."""
    random = np.random.default_rng(rows * columns).uniform(0, 1, (rows, columns, 3))
    return np.maximum(random - 0.2, 0)**power


IMAGES = {"noise": noise(11, 14), "range": noise(40, 30, 12.0), "one column": noise(7, 1), "three rows": noise(3, 9),
          "even": np.ones((6, 7, 3)), "one texel": np.ones((3, 1, 3)), "wide": noise(4, 700),
          "first pole": one_texel(0, 3), "last pole": one_texel(4, 3), "seam": one_texel(2, 0), "far": one_texel(2, 7)}


@pytest.fixture(params=IMAGES.values(), ids=IMAGES)
def texels(request: pytest.FixtureRequest) -> np.ndarray:
    found: np.ndarray = request.param
    return found


def integral(image: np.ndarray) -> np.ndarray:
    """∫ of the bilinear image over the sphere, (…,), cell by cell, by Gauss's quadrature."""
    rows, columns = image.shape[:2]
    points, weights = np.polynomial.legendre.leggauss(GAUSS)
    points, weights = (points + 1) / 2, weights / 2
    azimuth = ((np.arange(columns)[:, None] + 0.5 + points) / columns).ravel() * 2 * np.pi
    polar = ((np.arange(rows - 1)[:, None] + points) / (rows - 1)).ravel() * np.pi
    d = np.stack(np.broadcast_arrays(np.sin(azimuth) * np.sin(polar)[:, None], np.cos(polar)[:, None] + 0 * azimuth,
                                     -np.cos(azimuth) * np.sin(polar)[:, None]), axis=-1).reshape(-1, 3)
    each = np.tile(weights, rows - 1) * np.sin(polar) * np.pi / (rows - 1)
    share = np.outer(each, np.tile(weights, columns) * 2 * np.pi / columns).ravel()
    return np.asarray(share @ bilinear(image, d))


def probabilities(tables: Tables, shape: tuple[int, ...]) -> np.ndarray:
    """How often the table picks each texel, bin by bin, as glsl/lib/environment.glsl reads it."""
    rows, columns = shape[:2]
    found = np.zeros((rows, columns))
    for band_bin in range(BINS):
        code, of_band, top, height = tables.table[rows, band_bin]
        band, first = divmod(int(code), BINS)
        assert first <= band_bin < first + of_band
        for block_bin in (range(BINS) if band_bin == first else ()):  # all bins of a band mean the same
            start, of_block, left, width = tables.table[rows + 1 + band, block_bin]
            assert start <= block_bin < start + of_block
            rows_of, columns_of = range(int(top), int(top + height)), range(int(left), int(left + width))
            for row, column in itertools.product(rows_of, columns_of):
                share, other_column, other_row, _ = tables.table[row, column].astype(np.float64)
                likely = of_band / BINS / BINS / (height * width)
                found[row, column] += likely * share
                found[int(other_row), int(other_column)] += likely * (1 - share)
    return found


def test_tents_have_their_integrals() -> None:
    """Each by quadrature; all together are the sphere, also where rows are so many that differences vanish."""
    for rows, columns in ((3, 1), (3, 4), (9, 5)):
        for row in range(rows):
            tent = np.zeros((rows, columns))
            tent[row, 0] = 1
            assert integral(tent) == pytest.approx(tent_integrals(rows, columns)[row], rel=1e-8)
    for rows in (3, 32, 33, 34, 500, 16384):
        assert columns * tent_integrals(rows, columns).sum() == pytest.approx(4 * np.pi, rel=1e-13)


def test_the_density_integrates_to_one(texels: np.ndarray) -> None:
    """By quadrature, and exactly by the tents; it is where the image is, near its brightness."""
    tables = tables_of(texels)
    assert integral(tables.density) == pytest.approx(1, abs=1e-7)
    assert (tables.density * tent_integrals(*texels.shape[:2])[:, None]).sum() == pytest.approx(1, abs=1e-12)
    size = np.linalg.norm(texels, axis=2)
    assert ((tables.density > 0) == (size > 0)).all()
    ratio = tables.density[size > 0] / size[size > 0] * integral(size)
    # A band of 1/32 has 16 bins, a block too: each is rounded to within half a bin and one that others need.
    assert ratio.min() > 0.9 and ratio.max() < 1.1


@pytest.mark.parametrize("compensated", [False, True])
def test_the_table_picks_texels_as_often_as_the_density_says(compensated: bool) -> None:
    for name in ("noise", "one column", "three rows", "even", "first pole", "far", "range"):
        texels = IMAGES[name]
        tables = tables_of(texels, compensated=compensated)
        expected = tables.density * tent_integrals(*texels.shape[:2])[:, None]
        np.testing.assert_allclose(probabilities(tables, texels.shape), expected, rtol=0, atol=1e-7, err_msg=name)


def test_an_alias_table_is_exact() -> None:
    """Of probabilities of any range, zeros among them, of the same ones, and where what one bin lacks is just what
    another has to spare."""
    rng = np.random.default_rng(4)
    for weights in (rng.random(1), np.ones(7), rng.random(1000), rng.random(1000)**30, np.eye(9)[8], np.eye(9)[0],
                    np.r_[np.zeros(500), rng.random(500)], np.tile([1, 3], 4), np.tile([9, 11], 500),
                    np.tile([9, 7, 5, 6, 6, 11, 13, 15, 14, 14], 2)):
        share, alias = sweep(weights / weights.sum())
        found = np.bincount(alias, (1 - share) / len(share), len(share)) + share / len(share)
        np.testing.assert_allclose(found, weights / weights.sum(), atol=1e-13)
        assert share.min() >= 0 and share.max() <= 1 and (share[weights == 0] == 0).all()


def test_runs_are_few_and_none_is_rare() -> None:
    rng = np.random.default_rng(5)
    for weights in (np.ones(1), np.ones(STRATA), np.ones(1000), rng.random(77)**20, np.eye(50)[49], np.eye(50)[0]):
        ends = runs(weights, STRATA)
        of_runs = np.add.reduceat(weights, ends[:-1])
        assert ends[0] == 0 and ends[-1] == len(weights) and len(of_runs) <= STRATA and (np.diff(ends) > 0).all()
        assert of_runs.min() > weights.sum() / STRATA * (1 - 1e-8)
        bins = whole_bins(of_runs)
        assert bins.sum() == BINS and bins.min() >= BINS // STRATA - 1
        np.testing.assert_allclose(bins, of_runs / weights.sum() * BINS, atol=1)


def test_compensation_leaves_what_is_above_the_mean(texels: np.ndarray) -> None:
    size = np.linalg.norm(texels, axis=2)
    mean = integral(size) / (4 * np.pi)
    density = tables_of(texels, compensated=True).density
    assert integral(density) == pytest.approx(1, abs=1e-7)
    if np.ptp(size) == 0:
        np.testing.assert_array_equal(density, tables_of(texels).density)  # nothing is above it
    else:
        assert ((density > 0) == (size > mean * (1 + 1e-6))).all()


def test_compensation_makes_the_balance_heuristic_better() -> None:
    """The variance over the sky of one direction drawn from it and one by the cosine, by quadrature."""
    environment = load_scene(data_dir("mitsuba_scenes") / "environment.xml").environment
    assert isinstance(environment, EnvironmentMap)
    polar, azimuth = (np.arange(80) + 0.5) / 80 * np.pi, (np.arange(160) + 0.5) / 160 * 2 * np.pi
    d = np.stack(np.broadcast_arrays(np.sin(azimuth) * np.sin(polar)[:, None], np.cos(polar)[:, None] + 0 * azimuth,
                                     np.cos(azimuth) * np.sin(polar)[:, None]), axis=-1).reshape(-1, 3)
    solid = np.repeat(np.sin(polar), 160) * (np.pi / 80)**2
    radiance = bilinear(environment_texels(environment), d @ np.array(environment.to_world)[:3, :3]).mean(axis=1)
    normals = np.random.default_rng(3).normal(size=(12, 3))
    variance = {}
    for compensated in (False, True):
        of_map, total = pdf(environment, d, compensated=compensated), 0.0
        for normal in normals / np.linalg.norm(normals, axis=1, keepdims=True):
            of_cosine = np.maximum(d @ normal, 0) / np.pi
            light = of_cosine * radiance
            each = light / np.maximum(of_map + of_cosine, 1e-300)
            means = (each * of_map) @ solid, (each * of_cosine) @ solid
            total += ((each**2 * (of_map + of_cosine)) @ solid - np.square(means).sum()) / (light @ solid)**2
        variance[compensated] = total / len(normals)
    assert variance[True] < 0.7 * variance[False]


def test_the_mean_is_that_of_the_bilinear_map(mi: Any, tmp_path: Path) -> None:
    """Times its scale, by quadrature; wherever it is turned, which changes no density either."""
    image = noise(9, 12).astype(np.float32)
    mi.Bitmap(image).write(str(tmp_path / "map.exr"))
    turned = '<transform name="to_world"><rotate x="1" angle="30"/></transform>'
    plain, other = environment(tmp_path), environment(tmp_path, f'<float name="scale" value="2.5"/>{turned}')
    expected = integral(image.astype(np.float64)) / (4 * np.pi)
    np.testing.assert_allclose(mean_radiance(plain), expected, rtol=1e-7)
    np.testing.assert_allclose(mean_radiance(other), 2.5 * expected, rtol=1e-7)
    assert texel_density(plain) is texel_density(other)
    d = np.random.default_rng(1).normal(size=(50, 3))
    rotation = np.array(other.to_world)[:3, :3]
    np.testing.assert_allclose(pdf(other, d @ rotation.T), pdf(plain, d), rtol=1e-9)


@pytest.mark.parametrize(("value", "scale"), [(0.0, 1.0), (1.0, 0.0)])
def test_black_maps_are_drawn_from_in_vain(mi: Any, tmp_path: Path, value: float, scale: float) -> None:
    """Their mean says so beforehand; who draws all the same is told in one line."""
    mi.Bitmap(np.full((4, 6, 3), value, dtype=np.float32)).write(str(tmp_path / "map.exr"))
    black = environment(tmp_path, f'<float name="scale" value="{scale}"/>')
    assert mean_radiance(black) == (0, 0, 0) and is_black(black)
    for draw in (sampling_functions, texel_density, sampling_table):
        with pytest.raises(HarnessError, match=r"^'map.exr' is black, so no direction can be drawn from it; take "):
            draw(black)


def test_a_map_that_changed_is_refused(mi: Any, tmp_path: Path) -> None:
    mi.Bitmap(np.ones((4, 6, 3), dtype=np.float32)).write(str(tmp_path / "map.exr"))
    loaded = dataclasses.replace(environment(tmp_path), digest="0" * 64)
    with pytest.raises(HarnessError, match=r"map.exr: the image changed since the scene was loaded"):
        texel_density(loaded)


def environment(folder: Path, options: str = "") -> EnvironmentMap:
    """Of map.exr in a folder."""
    scene = folder / "scene.xml"
    scene.write_text(f"""<scene version="3.0.0">
        <integrator type="path"><integer name="max_depth" value="2"/></integrator>
        <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="8"/>
        <integer name="height" value="8"/><rfilter type="box"/></film></sensor>
        <emitter type="envmap"><string name="filename" value="map.exr"/>{options}</emitter></scene>""",
                     encoding="utf-8")
    found = load_scene(scene).environment
    assert isinstance(found, EnvironmentMap)
    return found


@pytest.mark.parametrize(("strategy", "table"), [("mixture", None), ("nee", "environment_table"),
                                                 ("mis", "compensated_environment_table")])
def test_compensated_draws_stand_beside_others_only(strategy: str, table: str | None) -> None:
    """Alone they would miss all that is darker than the mean."""
    scene = load_scene(data_dir("mitsuba_scenes") / "environment.xml")
    assert drawn_by(scene_chunk(scene, strategy)) == table
