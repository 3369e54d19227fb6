"""What changed between two studies: found where there is something, silent where there is nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.stats.changes import Measured, difference, from_interval, log_error
from harness.studies.changes import CellChange, compare_products
from harness.studies.product import StudyProduct
from tests.support.studies import SPP, line, product, study


def one(**options: object) -> StudyProduct:
    return StudyProduct((), (study(line("mixture", **options)),))  # type: ignore[arg-type]


def cell(before: StudyProduct, after: StudyProduct) -> CellChange:
    found, = compare_products(before, after).cells
    return found


def told(found: CellChange) -> set[str]:
    return {change.quantity for change in found.changes if change.changed}


def test_nothing_changed_where_only_the_numbers_are_others() -> None:
    changes = compare_products(product(seed=1), product(seed=2))
    assert len(changes.cells) == 12 and {found.verdict for found in changes.cells} == {"not distinguishable"}
    assert not changes.worse
    assert changes.tests == 12 * 8 and changes.level == pytest.approx(0.01 / changes.tests, rel=0.01)


@pytest.mark.parametrize(("options", "quantities", "worse"), [
    ({"error": 1.3}, {"rmse", "efficiency"}, True),
    ({"error": 0.7}, {"rmse", "efficiency"}, False),
    ({"slope": -0.4}, {"rmse", "slope", "efficiency"}, True),
    ({"bias": 0.0015}, {"mean error"}, True),  # which still passes
    ({"seconds": 0.02}, {"seconds", "efficiency"}, False),  # of the machine, at that moment
])
def test_what_changed_is_named_with_its_interval(options: dict[str, float], quantities: set[str], worse: bool) -> None:
    found = cell(one(seed=1), one(seed=2, **options))
    assert (found.verdict, told(found), found.worse) == ("changed", quantities, worse)


def test_ratios_are_of_b_over_a() -> None:
    found = {change.quantity: change for change in cell(one(seed=1), one(seed=2, error=1.3, seconds=0.02)).changes}
    assert found["rmse"].low < 1.3 < found["rmse"].high and found["rmse"].samples == 64
    assert found["seconds"].low < 2 < found["seconds"].high
    assert found["efficiency"].low < 1 / (2 * 1.3**2) < found["efficiency"].high


def test_cells_of_one_side_are_told_and_compared_with_nothing() -> None:
    both = product(seed=1)
    fewer = StudyProduct(both.axes, both.studies[:4])
    found = compare_products(both, fewer)
    assert [each.verdict for each in found.cells].count("only in A") == 4 and not found.worse
    assert {each.parameters[0][1] for each in found.cells if each.verdict == "only in A"} == {"100"}
    assert {each.verdict for each in compare_products(fewer, both).cells} == {"not distinguishable", "only in B"}


def test_a_verdict_that_fails_now_is_worse() -> None:
    before, after = one(bias=0.0), one(bias=0.05)
    assert cell(before, after).worse and (cell(before, after).a, cell(before, after).b) == ("pass", "fail")
    back = cell(after, before)
    assert back.verdict == "changed" and not back.worse


def test_seconds_of_two_devices_are_not_compared() -> None:
    found = cell(one(seed=1), one(seed=2, device="another"))
    assert {change.quantity for change in found.changes} == {"mean error", "rmse", "slope"}
    assert found.notes == ("seconds have no ratio: 'llvmpipe (LLVM 15.0.6, 256 bits)' and 'another'",)


def test_another_scene_of_the_same_name_is_told() -> None:
    after = one(seed=2)
    after = StudyProduct((), (replace(after.studies[0], scene_hash="1" * 16),))
    assert cell(one(seed=1), after).notes == ("the scene, its size or its depth differs",)


def test_what_has_no_spread_is_unknown() -> None:
    """One replica, and a verdict without variance."""
    alone = one(replicas=1, spp=SPP[-1:])
    item, = alone.studies[0].strategies
    unknown = np.full(4, np.nan)
    item = replace(item, verdict=replace(item.verdict, low=unknown, high=unknown))
    found = StudyProduct((), (replace(alone.studies[0], strategies=(item,)),))
    assert cell(found, found).verdict == "unknown"


def test_studies_of_nothing_in_common_are_refused() -> None:
    with pytest.raises(HarnessError, match=r"no cell in common .*in A: ball mixture; in B: ball alpha=1 lens=none uni"):
        compare_products(one(), product())


class TestDifference:
    """Welch's test, of measurements of any kind."""

    def test_finds_nothing_as_often_as_it_says(self) -> None:
        random = np.random.default_rng(2)
        alarms = 0
        for _ in range(2000):
            a, b = random.standard_normal(5), 3 * random.standard_normal(9)
            found = difference(*(Measured(x.mean(), x.std(ddof=1) / math.sqrt(len(x)), len(x) - 1) for x in (a, b)),
                               0.05)
            alarms += bool(found.changed)
        assert 0.03 < alarms / 2000 < 0.065

    def test_of_exact_values_is_exact(self) -> None:
        found = difference(Measured(1.0, 0.0, math.inf), Measured(1.5, 0.0, math.inf), 0.01)
        assert (found.value, found.low, found.high, found.changed) == (0.5, 0.5, 0.5, True)
        assert difference(Measured(1.0, 0.0, math.inf), Measured(1.0, 0.0, math.inf), 0.01).changed is False

    def test_of_the_unknown_is_unknown(self) -> None:
        assert difference(Measured(1.0, math.nan, 3), Measured(2.0, 0.1, 3), 0.01).changed is None
        assert difference(Measured(1.0, 0.1, 0), Measured(2.0, 0.1, 3), 0.01).changed is None

    def test_with_known_variances_is_normal(self) -> None:
        found = difference(Measured(0.0, 3.0, math.inf), Measured(0.0, 4.0, math.inf), 0.05)
        assert found.high == pytest.approx(1.959964 * 5)

    def test_takes_the_spread_from_an_interval(self) -> None:
        found = from_interval(1.0, 1.0 - 2.776445, 1.0 + 2.776445, 0.95, 4)
        assert found.error == pytest.approx(1.0, abs=1e-5)

    def test_takes_errors_of_replicas_on_a_log_scale(self) -> None:
        found = log_error(np.array([0.1, 0.1, 0.1]))
        assert (found.value, found.error) == (pytest.approx(math.log(0.1)), pytest.approx(0.0, abs=1e-12))
        assert math.isnan(log_error(np.array([0.1, 0.0])).error)
