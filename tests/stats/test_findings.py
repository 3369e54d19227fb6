"""What is told of tiles: the right tile, the right channel, and how many samples would decide."""

from __future__ import annotations

import numpy as np
import pytest

from harness.stats.findings import Tiles, judge_tiles, largest_deviates
from harness.stats.needed import factor_to_decide, times
from harness.stats.tiles import TileAccumulator, TileSamples
from harness.stats.verdicts import Tolerance

TILE = 4
SHAPE = (32, 48, 4)


def noisy(rng: np.random.Generator, truth: np.ndarray, sigma: float, batches: int = 32) -> TileSamples:
    """Batches of an image whose pixels have the relative standard error `sigma` in the mean of all batches."""
    accumulator = TileAccumulator(TILE)
    for _ in range(batches):
        accumulator.add(truth * (1 + sigma * np.sqrt(batches) * rng.standard_normal(truth.shape)), 1)
    return accumulator.samples()


def judged(test: TileSamples, reference: TileSamples, tolerance: Tolerance | None = None) -> Tiles:
    return judge_tiles(test, reference, tolerance or Tolerance(), fail_level=0.001, pass_level=0.05)


@pytest.fixture
def ones() -> np.ndarray:
    return np.ones(SHAPE)


def test_a_defect_is_placed_in_its_tile_and_channel(rng: np.random.Generator, ones: np.ndarray) -> None:
    defect = ones.copy()
    defect[8:12, 20:24, 1] = 0.8
    found = judged(noisy(rng, defect, 0.02), TileSamples.exact(ones, TILE))
    assert found.failed and found.fine.outcome == "fail"
    assert (found.fine.x, found.fine.y, found.fine.channel) == (20, 8, "green")
    assert found.fine.low < -0.2 < found.fine.high
    assert found.fine.error == pytest.approx(-0.2, abs=0.02)
    assert found.fine.z[2, 5] < -found.fine.critical
    assert found.fine.p < found.fine.fail_level
    assert (found.coarse.tile, found.coarse.z.shape, found.fine.z.shape) == (16, (2, 3), (8, 12))


def test_a_defect_of_many_small_tiles_shows_in_the_larger_ones(rng: np.random.Generator, ones: np.ndarray) -> None:
    """4 % over a larger tile: within the tolerance of a smaller, outside that of a larger."""
    defect = ones.copy()
    defect[16:32, 16:32] = 1.04
    found = judged(noisy(rng, defect, 0.02), TileSamples.exact(ones, TILE))
    assert (found.coarse.outcome, found.coarse.x, found.coarse.y) == ("fail", 16, 16)
    assert found.fine.outcome != "fail"
    assert found.failed


def test_a_right_render_passes_with_the_samples_that_were_said_to_be_needed(rng: np.random.Generator,
                                                                            ones: np.ndarray) -> None:
    exact = TileSamples.exact(ones, TILE)
    few = judged(noisy(rng, ones, 0.2), exact).fine
    assert few.outcome == "inconclusive" and few.needed > 2
    assert few.told == f"{few.reason}, {times(few.needed)} as many"
    many = [judged(noisy(rng, ones, 0.2 / np.sqrt(few.needed)), exact).fine.outcome for _ in range(10)]
    assert many.count("pass") >= 8
    fewer = [judged(noisy(rng, ones, 0.2 / np.sqrt(few.needed / 2)), exact).fine.outcome for _ in range(10)]
    assert fewer.count("pass") <= 5


def test_what_was_sure_to_show_shows(rng: np.random.Generator, ones: np.ndarray) -> None:
    """A tile off by the smallest bias that its size of tiles detects fails in 95 of 100 cases or more."""
    exact = TileSamples.exact(ones, TILE)
    size = judged(noisy(rng, ones, 0.1), exact).fine.detectable
    assert Tolerance().fine < size[0] <= size[1]
    defect = ones.copy()
    defect[8:12, 20:24] += size[1]
    assert sum(judged(noisy(rng, defect, 0.1), exact).fine.outcome == "fail" for _ in range(20)) >= 17


def test_rounding_is_no_deviation(ones: np.ndarray) -> None:
    """Without noise any difference has an infinite ratio to it, also the last bit of a float."""
    found = judged(TileSamples.exact(ones * (1 + 1e-7), TILE), TileSamples.exact(ones, TILE))
    assert found.fine.outcome == found.coarse.outcome == "pass"
    assert not found.fine.z.any()
    plain = judged(TileSamples.exact(ones * (1 + 1e-5), TILE), TileSamples.exact(ones, TILE))
    assert plain.fine.z.min() > 30


def test_an_unknown_variance_asks_for_no_number_of_samples(rng: np.random.Generator, ones: np.ndarray) -> None:
    found = judged(noisy(rng, ones, 0.1, batches=1), TileSamples.exact(ones, TILE)).fine
    assert (found.outcome, found.needed) == ("inconclusive", np.inf)
    assert found.told == found.reason
    assert found.detectable == (np.inf, np.inf)


def test_the_largest_of_channels_keeps_its_sign() -> None:
    z = np.array([[[1.0, -3.0, 2.0, np.nan]]])
    assert largest_deviates(z).tolist() == [[-3.0]]


class TestFactor:
    """Samples that decide."""

    def test_of_a_single_interval_follows_the_normal_distribution(self) -> None:
        """|error| + 1.96 σ within τ with probability .95 takes τ = 3.92 σ."""
        assert factor_to_decide(np.array([1.0]), 1.96) == pytest.approx(3.92**2, rel=0.02)
        assert factor_to_decide(np.array([0.1]), 1.96) == pytest.approx(0.1537, rel=0.02)

    def test_grows_with_the_number_of_intervals_and_ends_somewhere(self) -> None:
        assert factor_to_decide(np.full(1000, 1.0), 1.96) > 1.7 * factor_to_decide(np.array([1.0]), 1.96)
        assert factor_to_decide(np.array([1.0, np.inf]), 1.96) == np.inf
        assert factor_to_decide(np.array([1e9]), 1.96) == np.inf

    @pytest.mark.parametrize(("factor", "words"), [
        (0.3, "about 1.1 times"), (3.14159, "about 3.1 times"), (4711.0, "about 4,700 times"),
        (np.inf, "more than a million times")])
    def test_is_told_in_words(self, factor: float, words: str) -> None:
        assert times(factor) == words
