"""Maps show sign and size truthfully: zero is neutral, limits saturate, what is undefined is grey."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from harness.report.blocks import Pictures
from harness.report.chapters.scenes import best_strategy, scene_chapter
from harness.report.figures import pictures
from harness.results import StudyResult
from tests.support.blocks import blocks
from tests.support.report import with_curves


def pixels(png: bytes) -> np.ndarray:
    """A PNG as (H, W, 3) integers."""
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=int)


def test_a_difference_is_blue_below_grey_at_and_yellow_above_zero() -> None:
    row = pixels(pictures.difference_png(np.array([[-0.5, -0.05, 0.0, 0.05, 0.5]]), 0.1))[0]
    assert row[0][2] > row[0][0] + 50 and row[1][2] > row[1][0] + 20
    assert np.ptp(row[2]) <= 5
    assert row[3][0] > row[3][2] + 20 and row[4][0] > row[4][2] + 50


def test_a_printer_without_colour_keeps_the_sign_of_a_difference() -> None:
    """Evenly lighter from too dark to too bright, so that no two differences have one grey; white is neither."""
    row = pixels(pictures.difference_png(np.linspace(-1, 1, 21)[None], 1.0))[0]
    grey = row @ np.array([0.299, 0.587, 0.114])
    assert (np.diff(grey) > 5).all() and np.ptp(np.diff(grey)) < 8
    assert pictures.UNDEFINED.min() > grey[-1] + 20


def test_both_ends_saturate_alike_and_the_undefined_is_white() -> None:
    image = pixels(pictures.difference_png(np.array([[0.1, 99.0, np.nan, np.inf]]), 0.1))[0]
    assert (image[0] == image[1]).all()
    assert (image[2] == pictures.UNDEFINED).all() and (image[3] == pictures.UNDEFINED).all()


def test_a_flip_map_is_evaluated_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """And read back with every bit, what is undefined too; another exposure is another map."""
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path))
    evaluated: list[float] = []

    def flip_map(test: np.ndarray, reference: np.ndarray, exposure: float) -> np.ndarray:
        evaluated.append(exposure)
        return np.where(np.arange(12).reshape(3, 4) == 5, np.nan, test[..., 0] / 3)

    monkeypatch.setattr(pictures, "flip_map", flip_map)
    test, reference = np.linspace(0, 1, 36).reshape(3, 4, 3), np.zeros((3, 4, 3))
    first, again, brighter = (pictures.perceived_map(test, reference, exposure) for exposure in (0.0, 0.0, 1.0))
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first, flip_map(test, reference, 0.0))
    assert evaluated == [0.0, 1.0, 0.0] and brighter.shape == (3, 4)


def test_flip_grows_brighter_from_black() -> None:
    row = pixels(pictures.perceived_png(np.array([[0.0, 0.1, 0.2]]), 0.2))[0].sum(axis=1)
    assert row[0] < 30 < row[1] < row[2]


def test_the_robust_limit_ignores_one_pixel_in_a_hundred_and_rounds_up() -> None:
    values = np.full((100, 100), 0.013)
    values[0, :50] = -40.0
    assert pictures.robust_limit([values], 1e-4) == 0.02
    values[0:2] = -0.3
    assert pictures.robust_limit([values], 1e-4) == 0.5
    assert pictures.robust_limit([np.zeros((4, 4)), np.full((2, 2), np.nan)], 1e-4) == 1e-4


@pytest.mark.parametrize(("value", "rounded"), [(1.0, 1.0), (1.01, 2.0), (0.021, 0.05), (0.06, 0.1), (7e-4, 1e-3)])
def test_limits_are_one_two_or_five(value: float, rounded: float) -> None:
    assert pictures.round_up(value) == rounded


def test_large_images_are_averaged_down_and_small_ones_left_alone() -> None:
    large = np.random.default_rng(3).uniform(size=(1025, 700, 3))
    small = pictures.shrink(large)
    assert pictures.shrink_factor(large) == 3 and small.shape == (341, 233, 3)
    np.testing.assert_allclose(small[5, 7], large[15:18, 21:24].mean((0, 1)))
    assert pictures.shrink(small) is small


def test_a_render_is_encoded_at_its_exposure() -> None:
    """Radiance 0.5 at +1 stop is white; 0.214 at 0 stops is the middle of the sRGB scale."""
    assert (pixels(pictures.display_png(np.full((4, 4, 3), 0.5), 1.0)) == 255).all()
    assert abs(pixels(pictures.display_png(np.full((4, 4, 3), 0.214), 0.0)) - 127.5).max() < 1


def test_the_least_noisy_suitable_strategy_is_pictured(study: StudyResult) -> None:
    """phong has no noise at all here, but it does not suit; with nothing that suits, it is shown after all."""
    silent = tuple(with_curves(s, rmse=s.curves["rmse"] * 0) if s.strategy == "phong" else s for s in study.strategies)
    shown = blocks(scene_chapter(replace(study, strategies=silent), "x", "x"), Pictures)[0].rows[0].pictures
    assert [picture.title for picture in shown] == [
        "GLSL, mixture", "Mitsuba", "Relative difference", "FLIP"]
    mixture = study.strategies[-1].estimate.mean
    assert shown[0].file.content == pictures.display_png(mixture, study.exposure)
    assert shown[1].file.content == pictures.display_png(study.reference.mean, study.exposure)
    assert best_strategy(replace(study, strategies=(study.strategies[2],))).strategy == "phong"


def test_the_maps_of_all_strategies_share_scales_that_the_unsuitable_do_not_stretch(study: StudyResult) -> None:
    suited = replace(study, strategies=tuple(s for s in study.strategies if s.suits))
    with_phong, without = (blocks(scene_chapter(each, "x", "x"), Pictures)[1] for each in (study, suited))
    assert [row.bar for row in with_phong.rows] == [row.bar for row in without.rows]
    assert [len(row.pictures) for row in with_phong.rows] == [5, 5, 5]
