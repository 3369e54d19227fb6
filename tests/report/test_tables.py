"""What a table leaves open it says with a dash, and not with a number."""

from __future__ import annotations

from dataclasses import replace

from harness.report import formats
from harness.report.tables import cost_table
from harness.results import StudyResult
from harness.studies.equal_error import equal_error


def test_evenly_spread_samples_have_no_variance_of_their_own(study: StudyResult) -> None:
    """Seen in a report: they were said to have the baseline's."""
    uniform, cosine = (each for each in study.strategies if each.strategy in ("uniform", "cosine"))
    shown = replace(study, strategies=(uniform, replace(cosine, expected=(-1.0, -0.75, -0.5))))
    equal = equal_error(shown)
    assert equal is not None
    assert [row[2].text for row in cost_table(shown, equal).rows] == [f"1{formats.TIMES}", formats.MISSING]
