"""Runs drawn from a bank: what they have of a real run's moments, and what the bank's mean is."""

from __future__ import annotations

import numpy as np
import pytest

from harness.stats.paired import largest_by_size, paired
from harness.stats.partings import PARTINGS, draw_pair
from harness.stats.resampling import (
    centred,
    draws,
    mirrored,
    noisy,
    resampled,
    resampled_pairs,
    shaded_patches,
)
from harness.stats.synthetic import Plan
from harness.stats.tiles import ImageMoments, TileSamples

SIZE, HEIGHT, WIDTH, TILE = 24, 22, 31, 2


@pytest.fixture
def bank(rng: np.random.Generator) -> TileSamples:
    """Skewed replicas; the first row of tiles is the same in all of them."""
    means = rng.gamma(0.5, 2.0, (SIZE, 11, 16, 4))
    means[:, 0] = 0.7
    return TileSamples(means, np.full(SIZE, 8.0), TILE, HEIGHT, WIDTH)


def test_moments_are_those_of_the_replicas_that_were_drawn(bank: TileSamples) -> None:
    chosen = draws(SIZE, 16, 5, stream=0)
    found = list(resampled(bank, chosen))
    assert len(found) == 5
    for run, moments in zip(chosen, found, strict=True):
        drawn = TileSamples(bank.means[run], bank.samples[run], TILE, HEIGHT, WIDTH)
        for mine, theirs in zip(moments, ImageMoments.of(drawn), strict=True):
            np.testing.assert_allclose(mine.mean, theirs.mean, rtol=1e-12)
            np.testing.assert_allclose(mine.variance, theirs.variance, rtol=1e-9, atol=1e-25)
            np.testing.assert_allclose(mine.third, theirs.third, rtol=1e-7, atol=1e-12)
            assert mine.dof == theirs.dof
            np.testing.assert_array_equal(mine.pixels, theirs.pixels)


def test_an_exact_bank_is_the_same_in_all_runs() -> None:
    exact = TileSamples.exact(np.full((HEIGHT, WIDTH, 4), 0.5), TILE)
    first, second = resampled(exact, np.zeros((2, 1), np.intp))
    assert first.fine.mean[0, 0, 0] == second.fine.mean[0, 0, 0] == 0.5
    assert np.isinf(first.fine.dof)


def test_nothing_drawn_is_nothing_found(bank: TileSamples) -> None:
    assert list(resampled(bank, np.zeros((0, 16), np.intp))) == []


class TestDraws:
    """Which replicas a run consists of."""

    def test_come_again_in_one_run_and_differ_between_runs_and_streams(self) -> None:
        chosen = draws(64, 64, 3, stream=0)
        assert chosen.shape == (3, 64) and chosen.min() >= 0 and chosen.max() < 64
        assert all(len(set(run)) < 50 for run in chosen.tolist()), "of 64 with replacement, 41 are expected"
        assert not np.array_equal(chosen[0], chosen[1])
        assert not np.array_equal(chosen, draws(64, 64, 3, stream=1))

    def test_begin_alike_for_gates_of_different_budgets(self) -> None:
        np.testing.assert_array_equal(draws(64, 16, 3, stream=0), draws(64, 64, 3, stream=0)[:, :16])


class TestCentred:
    """A bank moved onto a known mean."""

    def test_has_the_mean_and_the_whole_variance(self, bank: TileSamples, rng: np.random.Generator) -> None:
        """Of the population that is drawn from, with divisor N, what the batches estimated with N - 1."""
        truth = rng.uniform(0.5, 2.0, bank.means.shape[1:])
        moved = centred(bank, truth)
        np.testing.assert_allclose(moved.means.mean(axis=0), truth, rtol=1e-12)
        np.testing.assert_allclose(moved.means.var(axis=0), bank.means.var(axis=0, ddof=1), rtol=1e-12, atol=1e-25)

    def test_stays_without_noise_where_it_had_none(self, bank: TileSamples) -> None:
        moved = centred(bank, np.full(bank.means.shape[1:], 1 / 3))
        assert (moved.means[:, 0] == 1 / 3).all()
        assert not noisy(moved)[0].any() and noisy(moved)[1:].all()


class TestPatches:
    """Squares of 1 % of the image."""

    def test_lie_where_all_tiles_are_noisy(self, rng: np.random.Generator) -> None:
        means = rng.standard_normal((4, 20, 20, 4))
        means[:, :, :14] = 1.0
        patches = shaded_patches(TileSamples(means, np.ones(4), 1, 20, 20), 50, rng)
        assert {side for *_, side in patches} == {2}
        assert {column for _, column, _ in patches} == {14, 15, 16, 17, 18}
        assert min(row for row, *_ in patches) < 5 < 13 < max(row for row, *_ in patches) <= 18

    def test_lie_where_most_is_where_nowhere_all_is(self, rng: np.random.Generator) -> None:
        means = np.ones((4, 20, 20, 4))
        means[:, 7, 9] = rng.standard_normal((4, 4))
        patches = shaded_patches(TileSamples(means, np.ones(4), 1, 20, 20), 20, rng)
        assert {(row, column) for row, column, _ in patches} <= {(6, 8), (6, 9), (7, 8), (7, 9)}


class TestPairs:
    """Coupled banks, whose replicas are drawn two by two."""

    def test_contrasts_are_those_of_the_pairs_drawn(self, rng: np.random.Generator) -> None:
        test, reference = draw_pair(PARTINGS["lamps"], Plan(side=60, batches=16, spp=64), 30.0, rng)
        largest = largest_by_size(test, reference)
        chosen = draws(16, 12, 3, 0)
        for run, contrasts in zip(chosen, resampled_pairs(test, reference, chosen, largest), strict=True):
            drawn = paired(test.chosen(run), reference.chosen(run))
            for found, expected in zip(contrasts, drawn, strict=True):
                assert np.isclose(found.single, expected.single, rtol=1e-10).mean() > 0.9
                assert (found.single >= expected.single * (1 - 1e-10)).all()  # two partings in a batch, of all the bank
                np.testing.assert_allclose(found.moments.test.variance, expected.moments.test.variance, rtol=1e-6)
                for error in (0.0, 1e-3):
                    for ours, theirs in zip(found.excess(error), expected.excess(error), strict=True):
                        np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-9 * np.abs(theirs).max())

    def test_a_mirrored_bank_has_no_bias_and_keeps_its_pairs(self, rng: np.random.Generator) -> None:
        test, reference = draw_pair(PARTINGS["bright"], Plan(side=60, batches=16, spp=64), 500.0, rng, drift=0.01)
        away = test.means - reference.means
        ours, theirs = mirrored(test, reference)
        moved = ours.means - theirs.means
        assert len(ours.samples) == 32 and np.abs(away.mean(axis=0)).min() > 0.001
        np.testing.assert_allclose(moved.mean(axis=0), 0.0, atol=1e-12)
        np.testing.assert_allclose(moved[:16], away, atol=1e-12)
        np.testing.assert_array_equal(theirs.means[16:], reference.means)
        assert ours.brightest is not None and ours.brightest.shape == ours.means.shape
