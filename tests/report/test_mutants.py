"""The chapter on seeded bugs: what it says follows from the kill matrix, in the PDF and in the page alike."""

from __future__ import annotations

from typing import Any

import pytest

from harness.errors import StoreError
from harness.report import formats
from harness.report.document import compose, typeset
from harness.report.html import html_page
from harness.report.mutants import mutants_chapter
from tests.support.report import study_result


def matrix(**states: tuple[str, str, str]) -> dict[str, Any]:
    """What `harness mutants` writes for mutants with these states at the gates `image`, `probe` and `other`."""
    gates = ["image", "probe", "other"]
    rows = {name: dict(zip(gates, row, strict=True)) for name, row in states.items()}
    return {
        "gates": gates,
        "mutants": [{"id": name, "topic": name[0], "file": "lib/phong.glsl", "imitates": f"defect {name}",
                     "origin": f"origin of {name}", "killer": "probe", "states": row} for name, row in rows.items()],
        "survivors": [name for name, row in rows.items() if "killed" not in row.values()],
        "idle": [gate for gate in gates if not any(row[gate] == "killed" for row in rows.values())
                 and any(row[gate] != "not run" for row in rows.values())],
        "missed": [name for name, row in rows.items() if "killed" in row.values() and row["probe"] != "killed"],
    }


MATRIX = matrix(a1=("killed", "killed", "not run"), a2=("survived", "killed", "not run"),
                b1=("survived", "survived", "not run"))


def test_nothing_comes_of_nothing() -> None:
    assert mutants_chapter(None) is None


def test_survivors_and_idle_gates_are_named() -> None:
    chapter = mutants_chapter(MATRIX)
    assert chapter is not None
    assert [(remark.mark, remark.text) for remark in chapter.remarks] == [
        ("fail", f"2 of 3{formats.NBSP}mutants killed."), ("fail", "Not noticed by any gate: b1.")]
    all_die = mutants_chapter(matrix(a=("untouched", "killed", "not run")))
    assert all_die is not None
    assert [remark.mark for remark in all_die.remarks] == ["pass", "warning"]
    assert "image" in all_die.remarks[1].text


def test_mutants_that_another_gate_killed_are_named() -> None:
    chapter = mutants_chapter(matrix(a=("killed", "survived", "not run"), b=("untouched", "killed", "not run")))
    assert chapter is not None
    assert [(remark.mark, remark.text) for remark in chapter.remarks] == [
        ("pass", f"2 of 2{formats.NBSP}mutants killed."),
        ("warning", "Killed, but not by the gate that the catalogue expects: a.")]


def test_gates_are_counted_and_those_that_did_not_run_left_out() -> None:
    chapter = mutants_chapter(MATRIX)
    assert chapter is not None
    rows = {row[0].text: [cell.text for cell in row[1:]] for row in chapter.gates.rows}
    assert rows == {"image": ["1", "2", "–", "–"], "probe": ["2", "1", "–", "1"]}


def test_each_mutant_has_its_killers_the_expected_one_first() -> None:
    chapter = mutants_chapter(MATRIX)
    assert chapter is not None
    assert [[cell.text for cell in row] for row in chapter.mutants.rows] == [
        ["a1", "defect a1", "origin of a1", "probe, image"], ["a2", "defect a2", "origin of a2", "probe"],
        ["b1", "defect b1", "origin of b1", "nothing"]]
    assert chapter.mutants.rows[2][3].mark == "fail"
    assert chapter.mutants.rules == (0, 2), "a line where the topic changes"


def test_it_stands_in_the_pdf_and_in_the_page() -> None:
    document = compose([study_result("a scene")], profile="quick", mutants=MATRIX)
    assert typeset(document).startswith(b"%PDF")
    page = html_page(document)
    assert "Bugs that must die" in page and "origin of a2" in page
    assert "Bugs that must die" not in html_page(compose([study_result("a scene")], profile="quick"))


@pytest.mark.parametrize("broken", [{}, {"gates": []}, {**MATRIX, "mutants": [{"id": "a"}]}])
def test_another_file_is_refused(broken: dict[str, Any]) -> None:
    with pytest.raises(StoreError, match=r"mutants' results: .*; run `harness mutants` again"):
        mutants_chapter(broken)
