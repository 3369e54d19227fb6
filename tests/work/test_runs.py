"""Runs: what is drawn, what is read back, how batches become an estimate, and the verdict on two of them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.policy import FALSE_ALARMS, fail_level, judge, tolerances
from harness.samples.estimate import Estimate
from harness.samples.store import LEAD_IN, Store
from harness.samples.traits import Traits
from harness.stats.verdicts import Tolerance
from harness.work.batches import batches, equal_batches, render_estimate
from harness.work.run import reference_run, tiles_of
from tests.support.fakes import NoiseRenderer


def test_a_run_covers_every_sample_once_and_in_order() -> None:
    drawn = list(batches(NoiseRenderer(), 300))
    assert sum(batch.samples for batch in drawn) == 300
    renderer = NoiseRenderer()
    list(batches(renderer, 300, replica=7))
    ends = [start + count for _, start, count in renderer.calls]
    assert [start for _, start, _ in renderer.calls] == [0, *ends[:-1]]
    assert {replica for replica, _, _ in renderer.calls} == {7}


def test_a_longer_run_renders_only_what_the_shorter_one_left(tmp_path: Path) -> None:
    store = Store(tmp_path)
    first, second = NoiseRenderer(), NoiseRenderer()
    short = render_estimate(first, 256, store=store)
    long = render_estimate(second, 512, store=store)
    assert [start for _, start, _ in second.calls if start >= LEAD_IN] == [256, 384]
    assert sum(count for _, start, count in second.calls if start < LEAD_IN) == LEAD_IN, "drawn again, not kept"
    assert long.samples == 512
    assert short.samples == 256


def test_a_run_from_the_store_equals_the_run_that_filled_it(tmp_path: Path) -> None:
    store = Store(tmp_path)
    cold = render_estimate(NoiseRenderer(), 300, store=store)
    again = NoiseRenderer()
    warm = render_estimate(again, 300, store=store)
    assert {start + count <= LEAD_IN for _, start, count in again.calls} == {True}
    np.testing.assert_array_equal(warm.mean, cold.mean)
    np.testing.assert_array_equal(warm.variance, cold.variance)
    assert warm.cost.seconds == pytest.approx(cold.cost.seconds)


def test_a_short_run_keeps_all_and_a_long_one_reads_it(tmp_path: Path) -> None:
    store = Store(tmp_path)
    cold = render_estimate(NoiseRenderer(), 32, store=store)
    again, longer = NoiseRenderer(), NoiseRenderer()
    warm = render_estimate(again, 32, store=store)
    assert not again.calls
    np.testing.assert_array_equal(warm.mean, cold.mean)
    render_estimate(longer, 256, store=store)
    assert [start for _, start, _ in longer.calls] == [32, 64, 128]


def test_a_long_run_keeps_three_images_in_seven_and_draws_an_eighth_again(tmp_path: Path) -> None:
    store = Store(tmp_path)
    render_estimate(NoiseRenderer(), 64, store=store)
    assert sorted(path.stem for path in tmp_path.rglob("*.exr")) == ["0-16-16", "0-32-32", "0-8-8"]


def test_a_long_run_of_what_does_not_repeat_itself_is_kept_whole(tmp_path: Path) -> None:
    """Else a second run would be another image, if only by rounding."""
    class Unrepeatable(NoiseRenderer):
        traits = Traits(repeats=False)

    store = Store(tmp_path)
    cold, again = render_estimate(Unrepeatable(), 300, store=store), Unrepeatable()
    np.testing.assert_array_equal(render_estimate(again, 300, store=store).mean, cold.mean)
    assert not again.calls


def test_an_interrupted_run_continues_where_it_was(tmp_path: Path) -> None:
    class Interrupted(NoiseRenderer):
        def render_batch(self, *arguments: object, **options: object) -> object:  # type: ignore[override]
            if len(self.calls) == 4:
                raise KeyboardInterrupt
            return super().render_batch(*arguments, **options)  # type: ignore[arg-type]

    store = Store(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        render_estimate(Interrupted(), 63, store=store)
    rest = NoiseRenderer()
    render_estimate(rest, 63, store=store)
    assert [start for _, start, _ in rest.calls] == [8, 16, 32]


@pytest.mark.parametrize("samples", [1, 2, 16, 100, 128, 1000, 1024, 4096])
def test_equal_batches_keep_every_sample_and_differ_little_in_size(samples: int) -> None:
    merged = list(equal_batches(batches(NoiseRenderer(size=(1, 1)), samples), samples))
    sizes = [batch.samples for batch in merged]
    assert sum(sizes) == samples
    if samples >= 1024 and samples % 128 == 0:
        assert set(sizes) == {128}
    assert len(sizes) >= min(4, samples)


def test_merging_small_batches_keeps_the_mean() -> None:
    run = list(batches(NoiseRenderer(), 1024))
    direct = sum(b.mean.astype(np.float64) * b.samples for b in run) / 1024
    merged = sum(b.mean.astype(np.float64) * b.samples for b in equal_batches(run, 1024)) / 1024
    np.testing.assert_allclose(merged, direct, rtol=1e-12)


def test_the_standard_error_is_that_of_the_samples() -> None:
    """300 pixels times three channels, 2048 samples: σ/√2048 within the few per cent that 16 batches allow."""
    estimate = render_estimate(NoiseRenderer(sigma=0.3, size=(20, 15)), 2048)
    assert np.sqrt(estimate.variance.mean()) == pytest.approx(0.3 / np.sqrt(2048), rel=0.05)


@pytest.mark.parametrize("samples", [0, -5])
def test_fewer_than_one_sample_is_refused(samples: int) -> None:
    with pytest.raises(HarnessError, match="at least 1"):
        list(batches(NoiseRenderer(), samples))


@pytest.mark.parametrize(("bias", "outcome"), [(0.0, "pass"), (0.01, "fail")])
def test_the_verdict_follows_the_bias(bias: float, outcome: str) -> None:
    truth = Estimate.exact(np.full((64, 64, 3), 0.5))
    test = render_estimate(NoiseRenderer(mean=0.5 * (1 + bias), size=(64, 64)), 2048)
    assert judge(test, truth).outcome == outcome


def test_too_few_samples_decide_nothing() -> None:
    truth = Estimate.exact(np.full((4, 4, 3), 0.5))
    assert judge(render_estimate(NoiseRenderer(size=(4, 4)), 16), truth).outcome == "inconclusive"


def test_a_level_of_its_own_decides_who_fails() -> None:
    """A bias of one and a half tolerances is plain at 5 %, not where a thousand verdicts share 1 %."""
    truth = Estimate.exact(np.full((16, 16, 3), 0.5))
    test = render_estimate(NoiseRenderer(mean=0.503, sigma=0.1, size=(16, 16)), 2048)
    assert judge(test, truth, tolerance=0.005).outcome == "fail"
    assert judge(test, truth, tolerance=0.005, fail_level=fail_level(1000)).outcome == "inconclusive"


def test_all_tests_of_a_family_together_have_its_rate() -> None:
    for family in (1, 75):
        assert 1 - (1 - fail_level(family)) ** (3 * family) == pytest.approx(FALSE_ALARMS)


def test_tiles_are_tolerated_in_proportion_to_the_mean() -> None:
    assert tolerances(0.002) == Tolerance()
    assert tolerances(0.02) == Tolerance(0.02, 0.125, 0.5)


@pytest.mark.parametrize(("spp", "length"), [
    (1, 1), (31, 1), (32, 1), (1000, 16), (1024, 32), (4096, 128), (2**20, 128)])
def test_a_reference_is_drawn_in_enough_batches(spp: int, length: int) -> None:
    """Lengths that others share, none longer than single precision can sum."""
    assert reference_run(NoiseRenderer(), spp).spp == length


@pytest.mark.parametrize(("spp", "length"), [
    (1, 1), (127, 1), (128, 4), (255, 4), (256, 16), (512, 16), (1024, 16), (2**20, 64)])
def test_or_in_square_ones(spp: int, length: int) -> None:
    assert reference_run(NoiseRenderer(), spp, square=True).spp == length


def test_tiles_of_an_unknown_variance_know_none() -> None:
    known = render_estimate(NoiseRenderer(size=(16, 24)), 64)
    assert np.isfinite(tiles_of(known, 4).moments().variance).all()
    unknown = dataclasses.replace(known, variance=np.full_like(known.variance, np.nan))
    for estimate in (unknown, dataclasses.replace(known, batches=1)):
        moments = tiles_of(estimate, 4).moments()
        assert np.isfinite(moments.mean).all() and np.isnan(moments.variance).all()
