"""Batches merge into the mean of all samples, with an unbiased variance of that mean."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from harness.samples.cost import Cost
from harness.samples.estimate import Accumulator, Batch, Estimate, RunningMean, luminance, merge, pixel_mean

UNEQUAL = (1, 1, 2, 4, 8, 16, 16, 5)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240601)


def random_batches(rng: np.random.Generator, sizes: tuple[int, ...] = UNEQUAL,
                   shape: tuple[int, int] = (3, 5)) -> tuple[list[Batch], list[np.ndarray]]:
    """Batches of gamma-distributed samples of shape (H, W, 3), and the samples themselves."""
    samples = [rng.gamma(2.0, 0.5, (n, *shape, 3)) for n in sizes]
    cost = Cost(0.5, 0.5, None, "cpu: test", "cpu")
    return [Batch(s.mean(axis=0), n, rejected=1, cost=cost) for s, n in zip(samples, sizes, strict=True)], samples


def test_merging_equals_the_mean_of_all_samples(rng: np.random.Generator) -> None:
    """Every sample weighs the same, whatever the size of the batch it came in."""
    batches, samples = random_batches(rng)
    merged = merge(batches)
    everything = np.concatenate(samples)
    np.testing.assert_allclose(merged.mean, everything.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(merged.image_mean[:3], everything.mean(axis=(0, 1, 2)), rtol=1e-12)
    np.testing.assert_allclose(merged.image_mean[3], luminance(everything).mean(), rtol=1e-12)
    assert (merged.samples, merged.batches, merged.rejected, merged.cost.seconds) == (53, 8, 8, 4.0)


@pytest.mark.parametrize("shape", [(1, 1, 3), (7, 5, 4), (96, 130, 3)])
def test_the_mean_over_pixels_is_numpys(rng: np.random.Generator, shape: tuple[int, ...]) -> None:
    image = rng.gamma(0.5, 2.0, shape)
    np.testing.assert_allclose(pixel_mean(image), image.mean((0, 1)), rtol=1e-13)


def test_the_running_mean_is_that_of_the_accumulator_to_the_last_bit(rng: np.random.Generator) -> None:
    whole, mean = Accumulator(), RunningMean()
    for batch in random_batches(rng)[0]:
        whole.add(batch)
        before = mean.mean
        mean.add(batch)
        assert mean.mean.tobytes() == whole.mean.tobytes() and mean.samples == whole.samples
        assert mean.mean is not before, "what was handed out does not change"


def test_variance_is_that_of_batch_means_weighted_by_samples(rng: np.random.Generator) -> None:
    """The one-pass update agrees with the textbook formula over all batches at once."""
    batches, _ = random_batches(rng)
    merged = merge(batches)
    weights = np.array([b.samples for b in batches])
    means = np.array([b.mean for b in batches])
    direct = np.einsum("b,bijc->ijc", weights, (means - merged.mean)**2) / (len(batches) - 1) / weights.sum()
    np.testing.assert_allclose(merged.variance, direct, rtol=1e-10)
    lights = luminance(means)
    direct = np.einsum("b,bij->ij", weights, (lights - luminance(merged.mean))**2) / (len(batches) - 1) / weights.sum()
    np.testing.assert_allclose(merged.luminance_variance, direct, rtol=1e-10)
    whole = np.concatenate([means.mean((1, 2)), lights.mean((1, 2))[:, None]], axis=1)
    direct = weights @ (whole - merged.image_mean)**2 / (len(batches) - 1) / weights.sum()
    np.testing.assert_allclose(merged.image_variance, direct, rtol=1e-10)


def test_third_moment_is_that_of_batch_means(rng: np.random.Generator) -> None:
    """The one-pass update agrees with the sums over all batches at once; two batches have none."""
    means = rng.lognormal(size=(9, 3, 4, 3)).astype(np.float32)
    sizes = rng.integers(1, 40, 9)
    merged = merge(Batch(mean, int(size)) for mean, size in zip(means, sizes, strict=True))
    direct = np.einsum("b,bijc->ijc", sizes, (means - merged.mean)**3) / (8 * 7 * sizes.sum())
    np.testing.assert_allclose(merged.third, direct, rtol=1e-8, atol=1e-12)
    whole = np.concatenate([means.mean((1, 2)), luminance(means).mean((1, 2))[:, None]], axis=1)
    direct = sizes @ (whole - merged.image_mean)**3 / (8 * 7 * sizes.sum())
    np.testing.assert_allclose(merged.image_third, direct, rtol=1e-5, atol=1e-12)  # of float32 means
    two = merge(Batch(mean, 4) for mean in means[:2])
    assert two.third is None and two.image_third is None


def test_variance_is_unbiased_for_unequal_batches(rng: np.random.Generator) -> None:
    """Over many pixels of unit variance per sample, the mean of the variances is 1/N to within its own noise."""
    side = 200
    sizes = np.array(UNEQUAL)
    merged = merge(Batch(rng.normal(0.0, n**-0.5, (side, side, 3)), n) for n in sizes)
    degrees = len(sizes) - 1
    noise = np.sqrt(2 / degrees / (3 * side**2))  # relative standard deviation of the mean of that many variances
    assert abs(merged.variance.mean() * sizes.sum() - 1) < 4 * noise


def test_image_variance_counts_what_pixels_have_in_common(rng: np.random.Generator) -> None:
    """Noise that all pixels share does not average out over the image."""
    shared = rng.normal(0.0, 1.0, 4000)
    merged = merge(Batch(np.full((4, 4, 3), value), 1) for value in shared)
    np.testing.assert_allclose(merged.image_variance, shared.var(ddof=1) / len(shared), rtol=1e-9)


def test_order_of_batches_does_not_matter(rng: np.random.Generator) -> None:
    """The first four batches give the same estimate in all 24 orders, to rounding."""
    batches, _ = random_batches(rng, sizes=(1, 7, 2, 30))
    expected = merge(batches)
    for order in itertools.permutations(batches):
        found = merge(order)
        np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-12)
        np.testing.assert_allclose(found.variance, expected.variance, rtol=1e-9)
        np.testing.assert_allclose(found.image_variance, expected.image_variance, rtol=1e-9)


def test_single_batch_has_a_mean_and_no_variance(rng: np.random.Generator) -> None:
    """One batch cannot tell its own noise."""
    merged = merge(random_batches(rng, sizes=(8,))[0])
    assert np.isfinite(merged.mean).all()
    assert np.isnan(merged.variance).all() and np.isnan(merged.luminance_variance).all()
    assert np.isnan(merged.image_variance).all()


def test_exact_answer_has_zero_variance_and_no_batches(rng: np.random.Generator) -> None:
    """A closed form is certain, which is not the same as unknown."""
    image = rng.random((3, 5, 3))
    exact = Estimate.exact(image)
    assert not exact.variance.any() and not exact.luminance_variance.any() and not exact.image_variance.any()
    assert (exact.batches, exact.samples) == (0, 0)
    np.testing.assert_allclose(exact.image_mean, [*image.mean((0, 1)), luminance(image).mean()], rtol=1e-12)


def test_estimate_does_not_change_when_more_is_added(rng: np.random.Generator) -> None:
    """Prefixes of a run are kept while the run goes on."""
    batches, _ = random_batches(rng)
    accumulator = Accumulator()
    for batch in batches[:4]:
        accumulator.add(batch)
    prefix = accumulator.estimate()
    mean, variance, image_mean = prefix.mean.copy(), prefix.variance.copy(), prefix.image_mean.copy()
    for batch in batches[4:]:
        accumulator.add(batch)
    np.testing.assert_array_equal(prefix.mean, mean)
    np.testing.assert_array_equal(prefix.variance, variance)
    np.testing.assert_array_equal(prefix.image_mean, image_mean)


def test_large_sums_keep_their_precision() -> None:
    """A variance of 1e-8 on a mean of 1000 survives merging, which float32 sums would lose."""
    values = 1000 + 1e-4 * np.array([-1.0, 1.0, -1.0, 1.0])
    merged = merge(Batch(np.full((1, 1, 3), v), 1) for v in values)
    np.testing.assert_allclose(merged.variance, (4e-8 / 3) / 4, rtol=1e-6)


def test_nothing_or_nonsense_is_refused(rng: np.random.Generator) -> None:
    """No batch, a batch without samples, and images of different size, even where numpy could stretch one."""
    with pytest.raises(ValueError, match="no batch"):
        merge([])
    with pytest.raises(ValueError, match="at least 1 sample"):
        merge([Batch(np.ones((2, 2, 3)), 0)])
    with pytest.raises(ValueError, match="expected an image of shape"):
        merge([Batch(np.ones((2, 2, 3)), 1), Batch(np.ones((1, 2, 3)), 1)])
