"""Image metrics against closed forms and published values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness import metrics
from harness.errors import HarnessError, StoreError
from harness.metrics import (
    delta_e2000,
    flip,
    flip_map,
    mean_error,
    relmse,
    rmse,
    signed_relative_difference,
    ssim,
)
from harness.report.blocks import Term
from harness.report.chapters.reading import glossary
from harness.report.tables import accuracy_table
from harness.samples.estimate import Estimate
from harness.samples.tone import encode_srgb
from harness.studies.storage import load_study, save_study
from harness.studies.table import records
from tests.support.metrics import register
from tests.support.report import exact_study

GREY = np.full((32, 40, 3), 0.25)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240603)


class TestEncodeSrgb:
    """IEC 61966-2-1."""

    @pytest.mark.parametrize(("linear", "encoded"), [
        (0.0, 0.0),
        (0.001, 0.01292),  # the linear toe
        (0.01, 0.0998528),  # the power law
        (0.0031308, 0.04045),  # where toe and power law meet
        (0.21404114, 0.5),  # middle of the code values
        (1.0, 1.0),
        (7.0, 1.0),
        (-1.0, 0.0),
        (np.inf, 1.0),
    ])
    def test_known_values(self, linear: float, encoded: float) -> None:
        assert encode_srgb(np.full(3, linear)) == pytest.approx(np.full(3, encoded), abs=1e-5)

    def test_exposure_is_in_stops(self) -> None:
        np.testing.assert_allclose(encode_srgb(GREY, 1.0), encode_srgb(2 * GREY))
        np.testing.assert_allclose(encode_srgb(GREY, -2.0), encode_srgb(GREY / 4))

    def test_nan_stays_nan(self) -> None:
        assert np.isnan(encode_srgb(np.array([np.nan, 0.0, 1.0]))).tolist() == [True, False, False]


class TestLinearErrors:
    """Errors in radiance."""

    def test_rmse_of_a_constant_offset_is_the_offset(self) -> None:
        assert rmse(GREY + 0.1, GREY) == pytest.approx(0.1)

    def test_rmse_averages_squares_over_pixels_and_channels(self) -> None:
        test = GREY.copy()
        test[0, 0, 0] += 3.0
        assert rmse(test, GREY) == pytest.approx(3.0 / np.sqrt(GREY.size))

    def test_rmse_leaves_out_the_noise_of_the_reference(self, rng: np.random.Generator) -> None:
        """Bias 0.1 and test noise 0.2 remain; the reference's 0.3 is gone, to within the noise of 120,000 values."""
        truth = np.full((200, 200, 3), 1.0)
        test = truth + 0.1 + rng.normal(0.0, 0.2, truth.shape)
        reference = truth + rng.normal(0.0, 0.3, truth.shape)
        assert rmse(test, reference) == pytest.approx(np.sqrt(0.01 + 0.04 + 0.09), rel=0.01)
        assert rmse(test, reference, noise=0.09 * truth) == pytest.approx(np.sqrt(0.01 + 0.04), rel=0.02)

    def test_errors_below_the_noise_are_zero(self) -> None:
        assert rmse(GREY + 0.1, GREY, noise=np.full(GREY.shape, 0.02)) == 0.0
        assert relmse(GREY + 0.1, GREY, noise=np.full(GREY.shape, 0.02)) == 0.0

    def test_unknown_noise_gives_an_unknown_error(self) -> None:
        assert np.isnan(rmse(GREY, GREY, noise=np.full(GREY.shape, np.nan)))
        assert np.isnan(relmse(GREY, GREY, noise=np.full(GREY.shape, np.nan)))

    def test_relmse_of_a_constant_offset(self) -> None:
        """0.1² / (0.25² + 0.01)."""
        assert relmse(GREY + 0.1, GREY) == pytest.approx(0.01 / 0.0725)
        assert relmse(GREY + 0.1, GREY, noise=np.full(GREY.shape, 0.004)) == pytest.approx(0.006 / 0.0725)

    def test_relmse_counts_light_where_the_reference_is_black(self) -> None:
        """0.1² / 0.01 = 1: neither zero nor infinite."""
        assert relmse(np.full(GREY.shape, 0.1), 0 * GREY) == pytest.approx(1.0)

    def test_relmse_leaves_out_one_pixel_in_a_thousand(self) -> None:
        """1280 pixels: the one firefly goes, of two the second stays."""
        test = GREY.copy()
        test[3, 4] = 1000.0
        assert relmse(test, GREY) == 0.0
        test[5, 6] = 1.25
        assert relmse(test, GREY) == pytest.approx(1.0 / 0.0725 / 1279)
        assert relmse(test, GREY, outliers=0.0) > 1000

    def test_relmse_outliers_are_pixels_and_not_channels(self) -> None:
        """Three broken channels of one pixel go, one channel of each of three pixels does not."""
        test = GREY.copy()
        test[3, 4] = (9.0, 99.0, 999.0)
        assert relmse(test, GREY) == 0.0
        test[3, 4:7] = np.diag((9.0, 99.0, 999.0))
        assert relmse(test, GREY) > 0.1

    def test_relmse_does_not_take_a_nan_for_an_outlier(self) -> None:
        test = GREY.copy()
        test[3, 4] = np.nan
        assert np.isnan(relmse(test, GREY))

    def test_mean_error_is_signed_and_relative(self) -> None:
        test = GREY * np.array([1.1, 1.0, 0.8])
        np.testing.assert_allclose(mean_error(test, GREY), [0.1, 0.0, -0.2, 0.1 * 0.2126 - 0.2 * 0.0722], atol=1e-12)

    def test_mean_error_sees_the_mean_and_not_the_pixels(self, rng: np.random.Generator) -> None:
        shuffled = rng.permutation(rng.random(GREY.shape), axis=0)
        np.testing.assert_allclose(mean_error(shuffled[::-1], shuffled), 0.0, atol=1e-12)

    def test_float32_images_are_averaged_in_float64(self) -> None:
        """A float32 mean of so many values drifts by more than the bias that is looked for."""
        image = np.full((2048, 2048, 3), 0.1, dtype=np.float32)
        assert abs(mean_error(image, image.astype(np.float64)).max()) < 1e-9


class TestSsim:
    """Structural similarity as displayed."""

    def test_identical_images_score_one(self, rng: np.random.Generator) -> None:
        image = rng.random(GREY.shape)
        assert ssim(image, image) == pytest.approx(1.0)

    def test_flat_images_score_the_luminance_term(self) -> None:
        """(2ab + C1) / (a² + b² + C1) with C1 = 0.01² (Wang et al. 2004, eq. 6), on encoded values; no structure."""
        a, b = encode_srgb(0.2), encode_srgb(0.5)
        assert ssim(np.full(GREY.shape, 0.2), np.full(GREY.shape, 0.5)) == pytest.approx(
            (2 * a * b + 1e-4) / (a**2 + b**2 + 1e-4))

    def test_inverted_structure_scores_below_zero(self, rng: np.random.Generator) -> None:
        """Covariance is minus the variance."""
        image = rng.random(GREY.shape) * 0.2
        shown = encode_srgb(image)
        flipped = 2 * shown.mean() - shown
        decoded = np.where(flipped <= 0.04045, flipped / 12.92, ((np.maximum(flipped, 0) + 0.055) / 1.055)**2.4)
        assert ssim(decoded, image) < -0.5

    def test_noise_lowers_it_step_by_step(self, rng: np.random.Generator) -> None:
        image = np.tile(np.linspace(0.1, 0.6, 40)[:, None], (32, 1, 3))
        noise = rng.normal(size=image.shape)
        scores = [ssim(image + level * noise, image) for level in (0.0, 0.01, 0.05, 0.2)]
        assert scores == sorted(scores, reverse=True)
        assert scores[3] < 0.5 < scores[1]

    def test_bright_emitter_does_not_hide_noise(self, rng: np.random.Generator) -> None:
        """On linear values with the emitter's range, 30 % noise would score 0.98."""
        image = GREY.copy()
        image[:4, :4] = 100.0
        noisy = image * (1 + 0.3 * rng.normal(size=image.shape))
        assert ssim(noisy, image) < 0.5

    def test_exposure_chooses_what_is_seen(self, rng: np.random.Generator) -> None:
        """Noise in a range that is displayed as white does not show."""
        noisy = 4.0 + 0.5 * rng.normal(size=GREY.shape)
        assert ssim(noisy, np.full(GREY.shape, 4.0)) == pytest.approx(1.0)
        assert ssim(noisy, np.full(GREY.shape, 4.0), exposure=-3.0) < 0.5

    def test_is_scikit_images_bit_for_bit_whatever_was_asked_before(self, rng: np.random.Generator) -> None:
        """Images of one reference in turn with others of another one, of another size, and at another exposure."""
        from skimage.metrics import structural_similarity

        references = [rng.gamma(2.0, 0.4, (40, 30, 3)), rng.gamma(2.0, 0.4, (17, 23, 3))]
        for index, exposure in ((0, 0.0), (0, 0.0), (1, 0.0), (0, -1.0), (0, -1.0), (1, 0.0)):
            reference = references[index]
            test = reference + rng.normal(0.0, 0.1, reference.shape)
            shown = (encode_srgb(image, exposure).astype(np.float32) for image in (test, reference))
            assert ssim(test, reference, exposure) == float(structural_similarity(
                *shown, data_range=1.0, channel_axis=-1, gaussian_weights=True, sigma=1.5,
                use_sample_covariance=False))

    def test_follows_a_reference_that_is_changed_in_its_place(self, rng: np.random.Generator) -> None:
        reference = rng.random((20, 20, 3))
        test = reference.copy()
        assert ssim(test, reference) == pytest.approx(1.0)
        reference[5:15, 5:15] = 0.0
        assert ssim(test, reference) < 0.9

    def test_image_smaller_than_the_window_is_refused(self) -> None:
        assert ssim(np.ones((11, 11, 3)), np.ones((11, 11, 3))) == pytest.approx(1.0)
        with pytest.raises(HarnessError, match="at least 11 x 11 pixels, found 20 x 10"):
            ssim(np.ones((10, 20, 3)), np.ones((10, 20, 3)))


class TestFlip:
    """FLIP, Andersson et al. 2020."""

    def test_identical_images_score_zero(self, rng: np.random.Generator) -> None:
        image = rng.random(GREY.shape)
        assert flip(image, image) == 0.0

    def test_black_against_white_is_near_one(self) -> None:
        """HyAB distance 100 to the power 0.7, compressed towards the largest one, 203.3 from green to blue."""
        distance, largest = 100**0.7, 203.3**0.7
        expected = 0.95 + 0.05 * (distance - 0.4 * largest) / (0.6 * largest)
        assert flip(np.ones(GREY.shape), np.zeros(GREY.shape)) == pytest.approx(expected, abs=1e-3)

    def test_greys_differ_by_lightness(self) -> None:
        """Of linear 0.25 and 0.36 (CIE 15:2018), to the power 0.7, on the lower part of the same curve."""
        distance, largest = (116 * (0.36 ** (1 / 3) - 0.25 ** (1 / 3)))**0.7, 203.3**0.7
        assert flip(np.full(GREY.shape, 0.36), GREY) == pytest.approx(0.95 * distance / (0.4 * largest), abs=1e-3)

    def test_map_shows_where(self) -> None:
        test = GREY.copy()
        test[10:14, 20:24] *= 2
        errors = flip_map(test, GREY)
        assert errors.shape == GREY.shape[:2]
        assert errors[10:14, 20:24].min() > 0.1
        assert errors[25:, :10].max() < 0.01
        assert flip(test, GREY) == pytest.approx(errors.mean())

    def test_exposure_is_fixed_and_not_sought(self) -> None:
        """Images that differ only where the display clips are the same."""
        assert flip(4 * np.ones(GREY.shape), 5 * np.ones(GREY.shape)) == 0.0
        assert flip(4 * np.ones(GREY.shape), 5 * np.ones(GREY.shape), exposure=-3.0) > 0.01

    def test_nan_does_not_pass_unseen(self) -> None:
        test = GREY.copy()
        test[3, 4, 1] = np.nan
        assert np.isnan(flip(test, GREY))
        assert np.isnan(flip_map(test, GREY)).sum() == 1


class TestDeltaE2000:
    """CIEDE2000."""

    @pytest.mark.parametrize(("first", "second", "expected"), [  # Sharma, Wu and Dalal 2005, table 1
        ((50.0000, 2.6772, -79.7751), (50.0000, 0.0000, -82.7485), 2.0425),
        ((50.0000, 3.1571, -77.2803), (50.0000, 0.0000, -82.7485), 2.8615),
        ((50.0000, 2.4900, -0.0010), (50.0000, -2.4900, 0.0011), 7.2195),
        ((50.0000, 2.5000, 0.0000), (56.0000, -27.0000, -3.0000), 31.9030),
        ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
        ((22.7233, 20.0904, -46.6940), (23.0331, 14.9730, -42.5619), 2.0373),
        ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
    ])
    def test_formula_reproduces_the_published_pairs(self, first: tuple[float, ...], second: tuple[float, ...],
                                                    expected: float) -> None:
        """The formula that delta_e2000 applies; most pairs lie outside what sRGB can show, so Lab goes in directly."""
        from skimage.color import deltaE_ciede2000

        assert deltaE_ciede2000(first, second) == pytest.approx(expected, abs=5e-5)

    def test_greys_differ_by_weighted_lightness(self) -> None:
        """With a = b = 0 only ΔL/S_L is left (Sharma et al. 2005, eq. 15); L from CIE 15:2018."""
        lightness = [116 * y ** (1 / 3) - 16 for y in (0.25, 0.36)]
        middle = (sum(lightness) / 2 - 50)**2
        expected = (lightness[1] - lightness[0]) / (1 + 0.015 * middle / np.sqrt(20 + middle))
        assert delta_e2000(np.full(GREY.shape, 0.36), GREY) == pytest.approx(expected, rel=1e-3)

    def test_mean_is_over_pixels(self) -> None:
        test = GREY.copy()
        test[:16] = 0.36
        assert delta_e2000(test, GREY) == pytest.approx(delta_e2000(np.full(GREY.shape, 0.36), GREY) / 2)

    def test_exposure_is_applied_first(self) -> None:
        assert delta_e2000(GREY * 0.72, GREY / 2, exposure=1.0) == pytest.approx(delta_e2000(GREY * 1.44, GREY))


def test_colours_agree_with_colour_science(rng: np.random.Generator) -> None:
    """An independent implementation of the whole chain: the sRGB curve, CIE Lab under D65, CIEDE2000."""
    import colour

    first, second = rng.random((2, 24, 24, 3)) * 1.2
    np.testing.assert_allclose(encode_srgb(first), colour.models.eotf_inverse_sRGB(np.clip(first, 0, 1)), atol=1e-9)
    lab = [colour.XYZ_to_Lab(colour.RGB_to_XYZ(np.clip(image, 0, 1), "sRGB"),
                             colour.CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["D65"])
           for image in (first, second)]
    expected = colour.delta_E(*lab, method="CIE 2000").mean()
    assert delta_e2000(first, second) == pytest.approx(expected, rel=2e-4)  # their rounded white points differ


class TestSignedRelativeDifference:
    """The picture of where it is too bright or too dark."""

    def test_sign_and_size(self) -> None:
        test = GREY.copy()
        test[0, 0] *= 1.1
        test[1, 1] *= 0.5
        found = signed_relative_difference(test, GREY)
        assert found.shape == GREY.shape[:2]
        assert found[0, 0] == pytest.approx(0.1) and found[1, 1] == pytest.approx(-0.5)
        assert np.count_nonzero(found) == 2

    def test_black_pixels_do_not_shout(self) -> None:
        reference = GREY.copy()
        reference[0, 0] = 0.0
        test = reference.copy()
        test[0, 0] = 0.0025
        mean = 0.25 * (1 - 1 / 1280)
        assert signed_relative_difference(test, reference)[0, 0] == pytest.approx(0.0025 / (0.01 * mean))
        assert np.isfinite(signed_relative_difference(test, 0 * reference)).all()


@pytest.mark.parametrize("metric", [rmse, relmse, mean_error, ssim, flip, delta_e2000, signed_relative_difference])
def test_images_that_cannot_be_compared_are_refused(metric: Callable[..., object]) -> None:
    """Different sizes, which numpy might stretch, and arrays that are no images."""
    with pytest.raises(HarnessError, match="test 40 x 1, reference 40 x 32"):
        metric(GREY[:1], GREY)
    with pytest.raises(HarnessError, match=r"test image must have shape \(height, width, 3\)"):
        metric(GREY[..., 0], GREY[..., 0])
    with pytest.raises(HarnessError, match="must have shape"):
        metric(GREY[:0], GREY[:0])


class TestRegistry:
    """What comparisons, studies, files and tables walk."""

    def test_measures_what_the_functions_do(self, rng: np.random.Generator) -> None:
        test, noise = rng.random((2, *GREY.shape))
        reference = replace(Estimate.exact(GREY), variance=0.01 * noise)
        assert metrics.measure(test, reference, 0.5) == {
            "rmse": rmse(test, GREY, 0.01 * noise), "relmse": relmse(test, GREY, 0.01 * noise),
            "mean_error": mean_error(test, GREY)[3], "ssim": ssim(test, GREY, 0.5), "flip": flip(test, GREY, 0.5),
            "delta_e2000": delta_e2000(test, GREY, 0.5)}

    def test_leaves_noise_in_where_it_is_not_known(self) -> None:
        unknown = replace(Estimate.exact(GREY), variance=GREY * np.nan)
        assert metrics.measure(GREY + 0.1, unknown, 0.0)["rmse"] == pytest.approx(0.1)

    def test_divides_metrics_between_curves_and_merged_estimates(self) -> None:
        along, once = (metrics.measure(GREY, Estimate.exact(GREY), 0.0, at_prefixes=which) for which in (True, False))
        assert list(along) == ["rmse", "mean_error", "ssim"]
        assert list(once) == ["relmse", "flip", "delta_e2000"]

    def test_names_each_metric_once_in_a_sentence_without_a_full_stop(self) -> None:
        names = [metric.name for metric in metrics.METRICS]
        assert len(set(names)) == len(names)
        assert all(metric.sentence and not metric.sentence.endswith(".") for metric in metrics.METRICS)

    def test_a_new_entry_reaches_studies_their_files_and_the_report(self, monkeypatch: pytest.MonkeyPatch,
                                                                    tmp_path: Path) -> None:
        register(monkeypatch)
        study = exact_study()
        save_study(study, tmp_path)
        first = load_study(tmp_path).strategies[0]
        np.testing.assert_array_equal(first.curves["largest_error"], study.strategies[0].curves["largest_error"])
        assert first.scores["share_off"] == study.strategies[0].scores["share_off"] == 1.0
        rows = [row for row in records(study) if row.estimator == "uniform"]
        assert sum(row.quantity == "largest_error" for row in rows) == first.curves["largest_error"].size == 3 * 7
        assert [row.value for row in rows if row.quantity == "share_off"] == [1.0]
        table = accuracy_table(study)
        cells = dict(zip((column.title for column in table.columns), table.rows[0], strict=True))
        assert cells["share off"].text == "1.00"
        assert float(cells["largest error\n(radiance)"].text) == pytest.approx(first.score("largest_error"), rel=0.01)
        assert "SSIM and largest error: of one replica" in table.caption
        assert "share off: part of the values that differ. " in table.caption
        term = Term("share off", "Part of the values that differ. It counts each colour. Lower is better.")
        assert term in glossary([]) and "FLIP" in {each.name for each in glossary([])}

    def test_a_study_kept_from_before_a_metric_was_added_is_measured_again(self, monkeypatch: pytest.MonkeyPatch,
                                                                          tmp_path: Path) -> None:
        save_study(exact_study(), tmp_path)
        register(monkeypatch)
        with pytest.raises(StoreError, match=r"metrics rmse, .*this version measures .*share_off\); remove it and run"):
            load_study(tmp_path)
