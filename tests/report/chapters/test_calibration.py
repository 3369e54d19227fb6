"""The chapter on the verdicts' own errors: every number shown, what is too high marked, and the pages whole."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from harness.report import Inputs, build_report
from harness.report.blocks import Chapter, Curves, Remark, Remarks, Table
from harness.report.chapters.calibration import ANCHOR, FIGURE_FILE, chapters
from harness.report.suite import suite_blocks
from harness.results import StudyResult
from harness.stats.calibration import SUBJECTS
from tests.support.blocks import blocks
from tests.support.calibration import calibration
from tests.support.report import exact_study


def chapter(excessive: int = 0) -> Chapter:
    found, = chapters(Inputs([exact_study()], "quick", calibration=calibration(excessive)))
    return found


def remarks(excessive: int = 0) -> tuple[Remark, ...]:
    return blocks(chapter(excessive), Remarks)[0].items


def alarms(excessive: int = 0) -> Table:
    return blocks(chapter(excessive), Table)[0]


def test_nothing_measured_is_no_chapter(exact: StudyResult) -> None:
    assert not list(chapters(Inputs([exact], "quick")))


def test_the_table_has_a_rate_with_its_interval_for_every_case_level_and_test() -> None:
    table = alarms()
    assert len(table.rows) == 2 * 2, "at 0.1 % nothing was to be expected of 300"
    first, second = table.rows[:2]
    assert [cell.text for cell in first[:3]] == ["normal / normal", "5", "5.0\xa0[2.8,\xa08.1]"]
    assert [cell.text for cell in second[:2]] == ["1", "1.0\xa0[0.2,\xa02.9]"]
    assert [len(row) for row in table.rows] == [2 + len(SUBJECTS), 1 + len(SUBJECTS)] * 2


@pytest.mark.parametrize(("excessive", "mark"), [(0, "pass"), (30, "fail")])
def test_a_rate_that_is_too_high_is_marked_and_told(excessive: int, mark: str) -> None:
    first = remarks(excessive)[0]
    assert first.mark == mark
    assert f"{int(excessive > 0)} lie above" in first.text
    assert [cell.mark for row in alarms(excessive).rows for cell in row].count("fail") == int(excessive > 0)


def test_power_is_told_at_the_tolerance_and_where_it_is_sure() -> None:
    texts = " ".join(remark.text for remark in remarks()).replace("\xa0", " ")
    assert "(0.200 %) passed in 0 of 60" in texts
    assert "one of 3.0 % failed in 60 of 60" in texts
    assert "a good render passed in 60 of 60 and failed in 0, after 75 % of the budget" in texts


def test_the_figure_holds_both_outcomes_and_every_case_without_tolerance() -> None:
    curves, = blocks(chapter(), Curves)
    texts = re.findall(r"<text[^>]*>(.*?)</text>", curves.file.content.decode())
    assert {"passed", "failed", "box"} <= set(texts)
    assert blocks(chapter(), Curves) == [curves], "the same bytes again"


def test_what_became_of_pairs_that_share_their_numbers_is_a_table() -> None:
    table = blocks(chapter(), Table)[1]
    assert [[cell.text.replace("\xa0", " ") for cell in row] for row in table.rows] == [
        ["16 replicas, tight: up to 4096 samples per pixel", "of everything", "0", "0.0", "100", "0", "50"],
        ["10", "2.0", "0", "95", "50"], ["in 1 % of the image", "250", "0.5", "10", "0", "50"]]
    assert [cell.rows for cell in table.rows[0][:2]] == [3, 2]


class TestSuite:
    """The section on the gates themselves."""

    def gates(self) -> Table:
        return next(block for block in suite_blocks(calibration().suite) if isinstance(block, Table))

    def test_every_gate_has_its_rates_and_its_power(self) -> None:
        sharp, blind = self.gates().rows
        assert [cell.text.replace("\xa0", " ") for cell in sharp] == [
            "sharp", "0.2", "0.0", "25", *["100 / 40"] * 4, "0.15 %", "4.5 %"]
        assert [cell.text.replace("\xa0", " ") for cell in blind] == [
            "blind", "0.0", "1.0", "75", *["10 / 0"] * 4, "0.50 %", "–"]
        assert len(self.gates().columns) == len(sharp)

    def test_what_keeps_the_promise_and_what_is_flaky_is_marked(self) -> None:
        sharp, blind = self.gates().rows
        assert [cell.mark for cell in sharp] == [*[""] * 8, "pass", "pass"]
        assert [cell.mark for cell in blind] == ["", "", "warning", *[""] * 7]

    @pytest.mark.parametrize(("failed", "mark"), [(2, "pass"), (30, "fail")])
    def test_false_alarms_are_told_and_judged(self, failed: int, mark: str) -> None:
        alarms, red, flaky, everywhere, patch = next(
            block.items for block in suite_blocks(calibration(failed=failed).suite) if isinstance(block, Remarks))
        assert alarms.mark == mark and f"in {failed}\xa0runs of 1,000 one of the 2\xa0gates failed" in alarms.text
        assert red.mark == "warning" and f"in {failed + 10}\xa0runs of 1,000" in red.text
        assert flaky.text.endswith("wider tolerances: blind (1.0\xa0%).")
        assert "0.2\xa0% of everything is sure to be noticed by 1 of 2\xa0gates: sharp." in everywhere.text
        assert "5\xa0% in 1\xa0% of the image is sure to be noticed by 1 of 2\xa0gates: sharp." in patch.text


def test_it_stands_in_the_pdf_and_the_page(exact: StudyResult, tmp_path: Path) -> None:
    build_report(Inputs([exact], "quick", calibration=calibration()), tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert '<h2 id="calibration">How far the verdicts can be trusted</h2>' in page
    assert '<h3 id="gates">The gates themselves</h3>' in page and "wider tolerances: blind" in page
    assert "5.0\xa0[2.8,\xa08.1]" in page and "normal, to a decision" in page
    held = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["chapters"]
    told = next(each for each in held if each["anchor"] == ANCHOR)
    assert alarms().caption in [block["caption"] for block in told["blocks"] if block["kind"] == "Table"]
    assert (tmp_path / "figures" / FIGURE_FILE).is_file() and (tmp_path / "report.pdf").is_file()
