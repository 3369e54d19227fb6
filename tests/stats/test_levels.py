"""Error rates shared by a family of tests and by repeated looks."""

from __future__ import annotations

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.stats.levels import Looks, family_level


class TestFamily:
    """One rate for many tests."""

    def test_independent_tests_err_together_at_the_familys_level(self) -> None:
        each = family_level(0.01, 60)
        assert 1 - (1 - each)**60 == pytest.approx(0.01)
        assert family_level(0.05, 1) == pytest.approx(0.05)

    def test_small_levels_keep_their_digits(self) -> None:
        assert family_level(1e-12, 1000) == pytest.approx(1e-15, rel=1e-6)

    @pytest.mark.parametrize(("level", "tests"), [(0.0, 3), (1.0, 3), (0.01, 0)])
    def test_nonsense_is_refused(self, level: float, tests: int) -> None:
        with pytest.raises(HarnessError, match="found"):
            family_level(level, tests)


class TestLooks:
    """A rate spent as samples are."""

    def test_spend_the_whole_rate_and_no_more(self) -> None:
        looks = Looks((8, 16, 32, 64, 128, 256))
        levels = [looks.level(k, 0.01) for k in range(len(looks.samples))]
        assert sum(levels) == pytest.approx(0.01)
        assert levels[-1] == pytest.approx(0.005)
        np.testing.assert_allclose(np.diff(levels)[1:], np.array(levels)[1:-1], err_msg="each twice the one before")

    def test_keep_the_level_of_a_drifting_mean(self, rng: np.random.Generator) -> None:
        """20000 walks tested two-sided at each of 5 looks: at most 5 %, and far more without the correction."""
        from harness.stats.deviates import critical_deviate

        looks = Looks((1, 2, 4, 8, 16))
        samples = np.array(looks.samples)
        walks = rng.normal(size=(20000, 16)).cumsum(axis=1)[:, samples - 1] / np.sqrt(samples)
        paid = [critical_deviate(looks.level(k, 0.05) / 2) for k in range(len(samples))]
        assert (np.abs(walks) > paid).any(axis=1).mean() < 0.05
        assert (np.abs(walks) > critical_deviate(0.025)).any(axis=1).mean() > 0.12

    @pytest.mark.parametrize("samples", [(), (0, 4), (4, 4), (8, 4)])
    def test_must_increase(self, samples: tuple[int, ...]) -> None:
        with pytest.raises(HarnessError, match="increasing"):
            Looks(samples)
