"""The chapter on seeded bugs: what it says follows from the kill matrix, in the PDF and in the page alike."""

from __future__ import annotations

from harness.report import Inputs, formats
from harness.report.blocks import Chapter, Remark, Remarks, Table
from harness.report.chapters.mutants import chapters
from harness.report.document import compose
from harness.report.pages.html import html_page
from harness.report.pages.typst import typeset
from harness.results import KillRecord, MutantRecord
from tests.support.blocks import blocks
from tests.support.report import exact_study, study_result


def matrix(**states: tuple[str, str, str]) -> KillRecord:
    """What `harness mutants` finds where mutants have these states at the gates `image`, `probe` and `other`."""
    gates = ("image", "probe", "other")
    rows = {name: dict(zip(gates, row, strict=True)) for name, row in states.items()}
    return KillRecord(
        gates, tuple(MutantRecord(name, name[0], "lib/phong.glsl", f"defect {name}", f"origin of {name}", "probe", row)
                     for name, row in rows.items()),
        survivors=tuple(name for name, row in rows.items() if "killed" not in row.values()),
        idle=tuple(gate for gate in gates if not any(row[gate] == "killed" for row in rows.values())
                   and any(row[gate] != "not run" for row in rows.values())),
        missed=tuple(name for name, row in rows.items() if "killed" in row.values() and row["probe"] != "killed"))


MATRIX = matrix(a1=("killed", "killed", "not run"), a2=("survived", "killed", "not run"),
                b1=("survived", "survived", "not run"))


def chapter(matrix: KillRecord | None) -> Chapter | None:
    return next(chapters(Inputs([exact_study()], "quick", mutants=matrix)), None)


def remarks(matrix: KillRecord) -> tuple[Remark, ...]:
    found = chapter(matrix)
    assert found is not None
    return blocks(found, Remarks)[0].items


def tables(matrix: KillRecord) -> list[Table]:
    """Of the gates, and of the mutants."""
    found = chapter(matrix)
    assert found is not None
    return blocks(found, Table)


def test_nothing_comes_of_nothing() -> None:
    assert chapter(None) is None


def test_survivors_and_idle_gates_are_named() -> None:
    assert [(remark.mark, remark.text) for remark in remarks(MATRIX)] == [
        ("fail", f"2 of 3{formats.NBSP}mutants killed."), ("fail", "Not noticed by any gate: b1.")]
    all_die = remarks(matrix(a=("untouched", "killed", "not run")))
    assert [remark.mark for remark in all_die] == ["pass", "warning"]
    assert "image" in all_die[1].text


def test_mutants_that_another_gate_killed_are_named() -> None:
    found = remarks(matrix(a=("killed", "survived", "not run"), b=("untouched", "killed", "not run")))
    assert [(remark.mark, remark.text) for remark in found] == [
        ("pass", f"2 of 2{formats.NBSP}mutants killed."),
        ("warning", "Killed, but not by the gate that the catalogue expects: a.")]


def test_gates_are_counted_and_those_that_did_not_run_left_out() -> None:
    rows = {row[0].text: [cell.text for cell in row[1:]] for row in tables(MATRIX)[0].rows}
    assert rows == {"image": ["1", "2", "–", "–"], "probe": ["2", "1", "–", "1"]}


def test_each_mutant_has_its_killers_the_expected_one_first() -> None:
    table = tables(MATRIX)[1]
    assert [[cell.text for cell in row] for row in table.rows] == [
        ["a1", "defect a1", "origin of a1", "probe, image"], ["a2", "defect a2", "origin of a2", "probe"],
        ["b1", "defect b1", "origin of b1", "nothing"]]
    assert table.rows[2][3].mark == "fail"
    assert table.rules == (0, 2), "a line where the topic changes"


def test_it_stands_in_the_pdf_and_in_the_page() -> None:
    document = compose(Inputs([study_result("a scene")], "quick", mutants=MATRIX))
    assert typeset(document).startswith(b"%PDF")
    page = html_page(document)
    assert "Bugs that must die" in page and "origin of a2" in page
    assert "Bugs that must die" not in html_page(compose(Inputs([study_result("a scene")], "quick")))
