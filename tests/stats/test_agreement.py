"""Agreement: which samples differ, and what their share decides."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from harness.errors import HarnessError
from harness.stats.agreement import agreement_verdict, differing, samples_to_agree, share_verdict


class TestDiffering:
    """Sample by sample, relative to itself."""

    def test_is_relative_to_the_larger_of_the_two_in_any_channel(self) -> None:
        reference = np.array([[1e-6] * 3, [100.0] * 3, [1.0] * 3, [0.0] * 3, [0.0] * 3, [2.0, 2.0, 2.0]])
        test = reference * np.array([1.002, 1.0009, 1.0, 1.0, 1.0, 1.0])[:, None]
        test[4, 1], test[5, 2] = 1e-9, 2.003
        assert differing(test, reference, 1e-3).tolist() == [True, False, False, False, True, True]
        assert differing(reference, test, 1e-3).tolist() == [True, False, False, False, True, True]

    def test_what_is_not_finite_differs_even_from_itself(self) -> None:
        broken = np.array([[np.nan, 1.0, 1.0], [np.inf, 1.0, 1.0], [1.0, 1.0, 1.0]])
        assert differing(broken, broken).tolist() == [True, True, False]

    def test_nonsense_is_refused(self) -> None:
        with pytest.raises(HarnessError, match="go in pairs"):
            differing(np.ones((2, 3)), np.ones((3, 3)))
        for threshold in (0.0, 1.0):
            with pytest.raises(HarnessError, match="part of themselves"):
                differing(np.ones((2, 3)), np.ones((2, 3)), threshold)


class TestShare:
    """A share of samples against a tolerance."""

    @pytest.mark.parametrize(("differing", "outcome"), [(0, "pass"), (6, "pass"), (14, "inconclusive"),
                                                        (23, "inconclusive"), (24, "fail"), (700, "fail")])
    def test_outcomes_are_those_of_exact_tests(self, differing: int, outcome: str) -> None:
        """Of 6,912 samples 13.8 may differ; 24 or more do by chance in 0.8 % of cases, 6 or fewer in 1.6 %."""
        found = share_verdict(differing, 6912, 0.002)
        assert found.outcome == outcome
        greater, less = (stats.binomtest(differing, 6912, 0.002, side).pvalue for side in ("greater", "less"))
        assert (found.outcome == "fail") == (greater < 0.01) and (found.outcome == "pass") == (less <= 0.025)
        low, high = stats.binomtest(differing, 6912).proportion_ci(0.95, method="exact")
        assert (found.low, found.high) == pytest.approx((low, high))
        assert f"{differing} of 6912 samples" in found.reason

    def test_smallest_detectable_fails_in_19_of_20(self) -> None:
        found = share_verdict(0, 6912, 0.002)
        fewest = next(k for k in range(6912) if share_verdict(k, 6912, 0.002).outcome == "fail")
        assert stats.binom.sf(fewest - 1, 6912, found.smallest_detectable) == pytest.approx(0.95)
        assert 0.002 < found.smallest_detectable < 0.006
        assert share_verdict(0, 1, 0.002).smallest_detectable == pytest.approx(0.95)

    def test_error_rates_at_the_tolerance(self, rng: np.random.Generator) -> None:
        """A share of just the tolerance fails in no more than 1 % of 4,000 runs, and passes in no more than 2.5 %."""
        hits = rng.binomial(6912, 0.002, 4000)
        known = {int(k): share_verdict(int(k), 6912, 0.002).outcome for k in np.unique(hits)}
        outcomes = [known[int(k)] for k in hits]
        assert 0 < outcomes.count("fail") <= 0.01 * 4000 + 3 * 6.3
        assert 0 < outcomes.count("pass") <= 0.025 * 4000 + 3 * 9.9

    def test_samples_needed_pass_and_fewer_do_not(self) -> None:
        assert samples_to_agree(0.0, 0.002) == int(np.ceil(np.log(0.025) / np.log1p(-0.002)))
        needed = samples_to_agree(5e-4, 0.002)
        for samples, chance in ((needed, 0.95), (needed // 2, 0.0)):
            most = max(k for k in range(40) if share_verdict(k, samples, 0.002).outcome == "pass")
            passes = stats.binom.cdf(most, samples, 5e-4)
            assert passes >= chance and (chance or passes < 0.9)

    def test_nonsense_is_refused(self) -> None:
        share = "must lie between 0 and 1"
        for arguments, message in (((0, 0), "expected some samples"), ((3, 2), "expected some samples"),
                                   ((0, 5, 0.0), share), ((0, 5, 1.0), share)):
            with pytest.raises(HarnessError, match=message):
                share_verdict(*arguments)
        with pytest.raises(HarnessError, match="error rate must lie"):
            share_verdict(0, 5, fail_level=0.0)
        with pytest.raises(HarnessError, match="only a share below the tolerance"):
            samples_to_agree(0.002, 0.002)


def test_a_lens_a_thousandth_too_wide_is_seen_where_the_mean_is_right(rng: np.random.Generator) -> None:
    """One path in 250 parts, as often to the bright side as to the dark; of a right shader one in 12,500."""
    reference = rng.random((72, 96, 3))

    def render(share: float) -> np.ndarray:
        parted = rng.random((72, 96, 1)) < share
        return np.where(parted, rng.random((72, 96, 3)), reference * (1 + 1e-6 * rng.standard_normal((72, 96, 3))))

    right, wide = (agreement_verdict(render(share), reference) for share in (8e-5, 4e-3))
    assert right.outcome == "pass" and right.samples == 72 * 96
    assert wide.outcome == "fail" and 0.002 < wide.share < 0.006
