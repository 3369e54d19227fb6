"""Which pictures are the same but for noise: on noise as heavy as that of paths, drawn from known distributions."""

from __future__ import annotations

import numpy as np
import pytest

from harness.diagnosis.causes.match import Seen, apart, factor_to, fit, gain, loglik, smaller
from harness.samples.estimate import Batch, Estimate, merge

SIZE = (24, 32)
LIGHT = 0.2 + np.add.outer(np.linspace(0, 1, SIZE[0]), np.linspace(0, 2, SIZE[1]) ** 2)[..., None] * [1.0, 0.8, 0.5]


def drawn(image: np.ndarray, seed: int, *, samples: int = 256, batches: int = 8, tail: float = 1.0) -> Estimate:
    """An estimate whose samples are log-normal about the image, its channels sharing their noise."""
    rng = np.random.default_rng(seed)
    each = samples // batches
    noise = rng.lognormal(-0.5 * tail**2, tail, (batches, each, *SIZE, 1)).mean(1)
    return merge(Batch(image * part, each) for part in noise)


def test_a_picture_is_the_same_as_itself_but_for_noise() -> None:
    """Of sixty pairs none is called different, and χ² is about 1."""
    fits = [fit(Seen.of(drawn(LIGHT, 2 * k)), Seen.of(drawn(LIGHT, 2 * k + 1))) for k in range(60)]
    assert all(result.same for result in fits)
    assert np.mean([result.chi2 for result in fits]) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("change", [
    lambda image: 1.04 * image,
    lambda image: image * np.where(np.arange(SIZE[1]) < 16, 1.06, 1.0)[None, :, None],
    lambda image: np.roll(image, 1, axis=1),
    lambda image: image[..., ::-1],
], ids=["four percent", "six percent on one side", "one pixel", "red and blue"])
def test_another_picture_is_excluded(change: object) -> None:
    assert callable(change)
    assert not fit(Seen.of(drawn(change(LIGHT), 1)), Seen.of(drawn(LIGHT, 2, samples=2048))).same


def test_pixels_that_share_their_noise_are_not_taken_for_a_difference() -> None:
    """A whole image that is a little brighter from batch to batch has one error, not one in each pixel."""
    rng = np.random.default_rng(3)
    shared = [Batch(LIGHT * (1 + rng.normal(0, 0.05)) * rng.normal(1, 0.05, (*SIZE, 1)), 32) for _ in range(8)]
    seen = Seen.of(merge(shared))
    assert seen.inflation > 50
    assert fit(seen, Seen.of(Estimate.exact(LIGHT))).p > 1e-3


def test_a_noisy_candidate_neither_fits_everything_nor_pays_for_its_noise() -> None:
    """By χ² alone a noisy picture of something else would win; by the likelihood alone a noisy true one would lose."""
    found = Seen.of(drawn(LIGHT, 1))
    noisy_other = Seen.of(drawn(1.2 * LIGHT, 2, samples=64, tail=1.5))
    true, noisy_true = Seen.of(drawn(LIGHT, 3)), Seen.of(drawn(LIGHT, 5, samples=64, tail=1.5))
    right = Seen.of(drawn(0.7 * LIGHT, 4, samples=4096))
    assert fit(found, noisy_other).chi2 < 1.1
    gains = [gain(found, each, right) for each in (true, noisy_true, noisy_other)]
    assert gains[0] > gains[1] > gains[2] + 50
    assert gains[1] > 100 and loglik(found, noisy_true) < loglik(found, Seen.of(drawn(0.9 * LIGHT, 6)))


def test_the_right_picture_gains_nothing_however_noisy_it_is_drawn() -> None:
    found, right = Seen.of(drawn(LIGHT, 1)), Seen.of(drawn(LIGHT, 2, samples=4096))
    for samples in (16, 64, 1024):
        assert abs(gain(found, Seen.of(drawn(LIGHT, 3, samples=samples)), right)) < 0.02 * LIGHT.size


def test_too_few_bright_samples_are_no_difference() -> None:
    """They make a tile too dark and too sure of it: the same error is told of one whose noise is not skewed, and of
    one that is too bright."""
    truth = Seen.of(Estimate.exact(LIGHT))
    variance = np.full_like(LIGHT, 0.01)
    error = np.zeros_like(LIGHT)
    error[8:16, 8:16] = 7.4 * np.sqrt(0.01 / 64)  # of the mean of 64 pixels, in standard errors
    skewed = np.full_like(LIGHT, 0.26 * np.sqrt(64) * 0.01**1.5)  # 0.26 is the skewness of that mean
    dark, bright = LIGHT - error, LIGHT + error
    assert fit(Seen(dark, variance, 1.0, 15.0, skewed), truth).p > 0.01
    assert not fit(Seen(dark, variance, 1.0, 15.0), truth).same
    assert not fit(Seen(bright, variance, 1.0, 15.0, skewed), truth).same


def test_tells_pictures_apart_by_the_image_s_noise() -> None:
    one, same, other = (Seen.of(drawn(image, seed, samples=2048, tail=0.4)) for seed, image in (
        (1, LIGHT), (2, LIGHT), (3, 1.03 * LIGHT)))
    fine, coarse = (Seen.of(drawn(LIGHT, 4, samples=samples)) for samples in (2048, 16))
    assert apart(one, same, fine) < 8
    assert apart(one, other, fine) > 8
    assert apart(one, other, coarse) < 8


def test_one_batch_tells_nothing() -> None:
    with pytest.raises(ValueError, match="at least two batches"):
        Seen.of(merge([Batch(LIGHT, 4)]))


def test_merges_pixels_as_a_wider_box_would() -> None:
    estimate = drawn(LIGHT, 1)
    merged = smaller(estimate, 4)
    assert merged.mean.shape == (6, 8, 3)
    assert merged.mean[0, 0] == pytest.approx(estimate.mean[:4, :4].mean((0, 1)))
    assert merged.variance[0, 0] == pytest.approx(estimate.variance[:4, :4].sum((0, 1)) / 256)
    with pytest.raises(ValueError, match="cannot be merged 5 by 5"):
        smaller(estimate, 5)


@pytest.mark.parametrize(("size", "factor"), [((64, 48), 1), ((512, 512), 8), ((640, 360), 8), ((97, 89), 1)])
def test_finds_the_least_factor(size: tuple[int, int], factor: int) -> None:
    assert factor_to(size, 5000) == factor
