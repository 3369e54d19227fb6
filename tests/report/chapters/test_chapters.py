"""Chapters are found by their files, and stand in the order that they ask for."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.report import Inputs, chapters
from harness.report.document import compose
from harness.report.pages.html import html_page
from harness.report.pages.typst import typeset
from harness.results import StudyResult

ADDED = '''"""A chapter on how many scenes there are."""

from harness.report.blocks import Chapter, Paragraph

PLACE = 66


def chapters(inputs):
    yield Chapter("Census", "census", (Paragraph(f"{len(inputs.results)} scene."),))
'''


def test_a_chapter_is_added_by_one_file(exact: StudyResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder that joins the package for the test: nothing else is touched, and both media have it."""
    (tmp_path / "census.py").write_text(ADDED, encoding="utf-8")
    monkeypatch.setattr(chapters, "__path__", [*chapters.__path__, str(tmp_path)])
    document = compose(Inputs([exact], "quick"))
    assert [chapter.title for chapter in document.chapters] == [
        "", "Verdicts", "Résumé en français", "How to read this", "Method", "Steps, difficulties and choices",
        "furnace_convex", "Is what is left noise?", "Speed", "What this cannot show", "Census", "Provenance",
        "References"]
    assert '<a href="#census">Census</a>' in html_page(document)
    assert typeset(document).startswith(b"%PDF")


def test_every_file_of_the_folder_is_a_chapter_with_a_place_of_its_own() -> None:
    folder = Path(chapters.__path__[0])
    places = [chapters.import_module(f"{chapters.__name__}.{path.stem}").PLACE
              for path in folder.glob("*.py") if path.stem != "__init__"]
    assert len(places) >= 8 and len(set(places)) == len(places)


def test_the_glossary_has_marks_in_place_and_one_line_a_term(exact: StudyResult) -> None:
    terms = next(chapter for chapter in compose(Inputs([exact], "quick")).chapters if chapter.anchor == "reading")
    text = str(terms.blocks)
    assert "✓ pass: with the stated confidence" in text and "{" not in text and "\\n" not in text
