"""The calibration of verdicts on differences: every case is counted, with little of each."""

from __future__ import annotations

import pytest

from harness.calibration import coupled
from harness.stats.calibration import SUBJECTS
from harness.stats.paired import COUPLED, TIGHT


@pytest.fixture(scope="module")
def measured() -> coupled.Coupled:
    """Three comparisons of fewer cases."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(coupled, "EXPECTED", (1.0,))
        patch.setattr(coupled, "POWER_REPLICAS", (16,))
        patch.setattr(coupled, "REPLICAS", 16)
        return coupled.compare_coupled(3)


def test_every_case_is_counted(measured: coupled.Coupled) -> None:
    cases, alarms, powers = measured
    assert {each.case for each in alarms} | {each.case for each in powers} == cases.keys()
    counted = {(each.case, each.subject): each.trials for each in alarms}
    null = {"coupled: 1 part, even", "coupled: 1 part, lamps", "coupled: drift, coupled", "coupled: drift, tight"}
    assert counted == {(case, subject): 3 for case in null for subject in SUBJECTS}


def test_power_is_of_both_sets_of_tolerances(measured: coupled.Coupled) -> None:
    *_, powers = measured
    both = (("coupled", COUPLED), ("tight", TIGHT))
    assert {(each.case, each.where, each.tolerance) for each in powers} == {
        (f"coupled: 16 replicas, {name}", where, allowed) for name, tolerance in both
        for where, allowed in (("everywhere", tolerance.mean), ("patch", tolerance.fine))}
    for each in powers:
        if each.where == "everywhere" and each.gain == 0:
            assert each.failed == 0
        if each.where == "patch" and each.gain >= 4 * each.tolerance:
            assert each.failed == each.trials


def test_pairs_are_drawn_anew_and_share_their_noise() -> None:
    (test, reference), (other, _) = coupled.pairs("even", 1.0, 16, 2)
    assert (test.means != other.means).all()
    away = (test.whole().means - reference.whole().means).std()
    assert away < 1e-3 * test.whole().means.std()
