"""The chapter on causes: its shares, the strangers that were missed, and those that were accused."""

from __future__ import annotations

import dataclasses

from harness.report import Inputs
from harness.report.blocks import Chapter, Remarks, Table
from harness.report.chapters.causes import ANCHOR, TITLE, chapters
from harness.report.document import compose
from harness.report.pages.html import html_page
from harness.studies.causes import Accused, CausesFile, CausesRecord, Missed
from tests.support.blocks import blocks
from tests.support.report import exact_study

RECORD = CausesRecord("spheres", (64, 48), 256, 120, 100, 97, 99, (
    Missed("half-circle", "uniform", "other-hash", "several", 2, "albedo-squared"),
    Missed("jitter-diagonal", "cosine", "", "unknown", 0, "")), 48, (), 60.0)
FILE = CausesFile("2026-11-28", {"mitsuba": "3.9.1", "drjit": "1.5.0"}, 1, 197, (RECORD,))


def chapter(found: CausesFile) -> Chapter:
    made, = chapters(Inputs([exact_study()], "quick", causes=found))
    return made


def test_nothing_comes_of_nothing() -> None:
    assert not list(chapters(Inputs([exact_study()], "quick")))


def test_shares_and_what_was_missed() -> None:
    remarks, = blocks(chapter(FILE), Remarks)
    assert "97.0" in remarks.items[0].text and "99.0" in remarks.items[0].text
    assert remarks.items[1].mark == "pass" and "none is accused" in remarks.items[1].text
    scenes, missed = blocks(chapter(FILE), Table)
    assert [cell.text for cell in scenes.rows[0]][:3] == ["spheres", "120", "100"]
    assert [row[1].text for row in missed.rows] == ["half-circle", "jitter-diagonal"]
    assert [row[4].text for row in missed.rows] == ["2", "–"]


def test_who_is_accused_is_named() -> None:
    accused = dataclasses.replace(RECORD, missed=(), accused=(Accused("roulette", "uniform", "unknown", ""),))
    found = chapter(dataclasses.replace(FILE, records=(accused,)))
    assert blocks(found, Remarks)[0].items[1].mark == "fail"
    assert "roulette on spheres" in blocks(found, Remarks)[0].items[1].text
    assert len(blocks(found, Table)) == 1


def test_stands_in_the_page() -> None:
    page = html_page(compose(Inputs([exact_study()], "quick", causes=FILE)))
    assert TITLE in page and f'id="{ANCHOR}"' in page and "half-circle" in page
