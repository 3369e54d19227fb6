"""The chapter on gates leads to what each left, and says nothing where none ran."""

from __future__ import annotations

import json
from pathlib import Path

from harness.gates.artefacts import RESULT_FILE, error_record, save_result
from harness.gates.evidence import evidence
from harness.gates.records import as_json
from harness.gates.runner import run_gate
from harness.report import Inputs
from harness.report.blocks import Remarks, Table
from harness.report.chapters.gates import chapters
from harness.report.document import compose
from harness.report.pages.html import html_page
from harness.results import GateEvidence, GateRecord, StudyResult
from tests.support.blocks import blocks
from tests.support.gates import Noise, judging, one_gate

PASSED = GateEvidence(GateRecord("sky", "pass", "fine"), "sky", ())


def test_no_chapter_without_gates(exact: StudyResult) -> None:
    assert not list(chapters(Inputs([exact], "quick")))


def test_gates_that_pass_are_counted(exact: StudyResult) -> None:
    chapter, = chapters(Inputs([exact], "quick", gates=[PASSED]))
    remark = blocks(chapter, Remarks)[0].items[0]
    assert (remark.text.replace("\u00a0", " "), remark.mark) == ("1 of 1 gate passed.", "pass")
    assert not blocks(chapter, Table)


def test_a_failed_gate_leads_to_its_files(exact: StudyResult, tmp_path: Path) -> None:
    """Every link of the page is a file that the gate left; what failed stands before what is undecided."""
    gate = one_gate(tmp_path)
    save_result(run_gate(judging(gate, Noise(0.01))), tmp_path / "gates" / "below" / "sky")
    (tmp_path / "gates" / "broken").mkdir()
    (tmp_path / "gates" / "broken" / RESULT_FILE).write_text(json.dumps(as_json(error_record(gate, ValueError("no")))))
    (tmp_path / "gates" / "other").mkdir()
    (tmp_path / "gates" / "other" / RESULT_FILE).write_text("[]")
    warnings: list[str] = []
    found = evidence(tmp_path / "gates", warnings.append)
    assert [each.folder for each in found] == ["below/sky", "broken"]
    assert warnings == [f"{tmp_path}/gates/other/{RESULT_FILE}: not the result of a gate; run the gate again, or "
                        "remove its folder"]
    undecided = GateEvidence(GateRecord("a", "inconclusive", "few"), "a", ())
    inputs = Inputs([exact], "quick", gates=[undecided, PASSED, *found])
    table = blocks(next(chapters(inputs)), Table)[0]
    assert [row[1].text for row in table.rows] == ["fail", "error", "inconclusive"]
    assert [row[1].mark for row in table.rows] == ["fail", "fail", "inconclusive"]
    links = table.rows[0][3].links
    assert {link.text for link in links} >= {"test.png", "test.exr", "difference", "z-map", "curve"}
    assert all((tmp_path / link.path).is_file() for link in links)
    assert 'href="gates/below/sky/z-map.png"' in html_page(compose(inputs))


def test_nothing_is_found_where_no_gate_ran(tmp_path: Path) -> None:
    assert evidence(tmp_path / "nowhere", lambda _: None) == ()
