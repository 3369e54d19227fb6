"""What a report reads back: chapters, the PDF and the page's font, each made again where anything of it changed."""

from __future__ import annotations

import dataclasses
import os
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import typst

from harness.report import remembered
from harness.report.blocks import Asset, Chapter, Curves, Document, Paragraph
from harness.report.chapters import scenes
from harness.report.figures.style import font_folder
from harness.report.inputs import Inputs
from harness.report.pages import html
from harness.report.pages import typst as pdf
from harness.report.remembered import remembered_chapters
from harness.results import StudyResult
from harness.samples.memo import ASIDE

CHAPTER = Chapter("One", "one", (Paragraph("Said."), Curves("A line", Asset("line.svg", b"<svg>ab</svg>"), "line")))


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of this test alone."""
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


class Counted:
    """Makes a chapter, and counts how often."""

    def __init__(self) -> None:
        self.made = 0

    def __call__(self) -> Iterator[Chapter]:
        self.made += 1
        yield CHAPTER

    def ask(self, *of: object) -> Chapter:
        found, = remembered_chapters(self, scenes.__name__, *of)
        return found


def altered(study: StudyResult, by: float = 1e-16) -> StudyResult:
    """The study, with one pixel of each strategy off by a part of it, or by the last bit."""
    def off(mean: np.ndarray) -> np.ndarray:
        changed = mean.copy()
        changed[3, 5, 1] = max(changed[3, 5, 1] * (1 + by), np.nextafter(changed[3, 5, 1], np.inf))
        return changed

    return dataclasses.replace(study, strategies=tuple(
        dataclasses.replace(each, estimate=dataclasses.replace(each.estimate, mean=off(each.estimate.mean)))
        for each in study.strategies))


class TestChapters:
    """Of the same they are made once."""

    def test_are_the_same_when_they_are_read_back(self, study: StudyResult) -> None:
        make = Counted()
        assert [make.ask(study, "a"), make.ask(study, "a")] == [CHAPTER, CHAPTER]
        assert make.made == 1

    def test_of_another_number_are_others(self, study: StudyResult) -> None:
        make = Counted()
        make.ask(study, "a")
        make.ask(altered(study), "a")
        make.ask([study], "b")
        make.ask([altered(study)], "b")
        assert make.made == 4

    def test_of_other_code_texts_and_packages_are_others(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        make = Counted()
        make.ask("a")
        texts = tmp_path / "texts"
        texts.mkdir()
        (texts / "method.toml").write_text("text = 'Other words.'")
        for name, value in (("code_digest", lambda *modules: "other"), ("FOLDER", texts),
                            ("_versions", lambda: {"matplotlib": "0"})):
            monkeypatch.setattr(remembered, name, value)
            make.ask("a")
            make.ask("a")
        assert make.made == 4

    def test_that_are_damaged_are_set_aside_and_made_again(self, cache: Path) -> None:
        make = Counted()
        make.ask("a")
        file, = (cache / "chapters").iterdir()
        file.write_bytes(file.read_bytes()[:-1] + b"x")
        assert make.ask("a") == CHAPTER and make.ask("a") == CHAPTER
        assert make.made == 2
        assert {path.name for path in file.parent.iterdir()} == {file.name, file.name + ASIDE}

    def test_name_nothing_but_blocks(self, monkeypatch: pytest.MonkeyPatch) -> None:
        class Wicked:
            def __reduce__(self) -> tuple[Callable[[str], int], tuple[str]]:
                return os.system, ("touch wicked",)

        monkeypatch.setattr(remembered, "remembered_bytes", lambda *_: pickle.dumps([Wicked()]))
        with pytest.raises(pickle.UnpicklingError, match="a chapter holds no"):
            Counted().ask("a")

    def test_of_a_scene_say_the_same_when_they_are_read_back(self, study: StudyResult) -> None:
        inputs = Inputs([study], "quick")
        first, second = (list(scenes.chapters(inputs)) for _ in range(2))
        assert first == second and first[0].title == study.scene
        assert list(scenes.chapters(Inputs([altered(study, by=0.5)], "quick"))) != first


def document(text: str = "Said.", date: str = "1 May") -> Document:
    return Document("Title", "subtitle", date, (CHAPTER, Chapter("Two", "two", (Paragraph(text),))))


class TestPdf:
    """Of the same document, fonts and typesetter it is set once."""

    @pytest.fixture
    def compiled(self, monkeypatch: pytest.MonkeyPatch) -> list[str]:
        """What was set, for which no typesetter is needed here."""
        done: list[str] = []

        def compile_(source: str, **settings: object) -> bytes:
            done.append(source)
            return f"PDF {len(done)}".encode()

        monkeypatch.setattr(typst, "compile", compile_)
        return done

    def test_of_the_same_is_read_back(self, compiled: list[str]) -> None:
        assert pdf.typeset(document()) == pdf.typeset(document()) == b"PDF 1"

    def test_of_another_word_date_or_figure_is_another(self, compiled: list[str]) -> None:
        figure = dataclasses.replace(CHAPTER, blocks=(Curves("A line", Asset("line.svg", b"<svg>ac</svg>"), "line"),))
        for each in (document(), document("Unsaid."), document(date="2 May"),
                     dataclasses.replace(document(), chapters=(figure,))):
            pdf.typeset(each)
        assert len(compiled) == 4

    def test_by_another_typesetter_template_or_font_is_another(
        self, compiled: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
    ) -> None:
        pdf.typeset(document())
        monkeypatch.setattr(pdf.metadata, "version", lambda name: "0.0.1")
        pdf.typeset(document())
        (tmp_path / pdf.TEMPLATE).write_text("// other")
        monkeypatch.setattr(pdf, "data_dir", lambda name: tmp_path)
        pdf.typeset(document())
        (tmp_path / "one.ttf").write_bytes(b"font")
        monkeypatch.setattr(pdf, "font_folder", lambda: tmp_path)
        pdf.typeset(document())
        (tmp_path / "one.ttf").write_bytes(b"tonf")
        pdf.typeset(document())
        assert len(compiled) == 5


def test_the_pages_font_is_cut_down_anew_for_other_letters_and_from_another_font(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
) -> None:
    cut: list[set[str]] = []

    def cut_down(font: bytes, letters: set[str]) -> bytes:
        cut.append(letters)
        return font[:4]

    monkeypatch.setattr(html, "_cut_down", cut_down)
    html.html_page(document())
    html.html_page(document("Unsaid."))
    other = dataclasses.replace(CHAPTER, blocks=(Curves("A line", Asset("line.svg", b"<svg>xyz</svg>"), "line"),))
    html.html_page(dataclasses.replace(document(), chapters=(other,)))
    (tmp_path / f"{html.FONT}.ttf").write_bytes((font_folder() / f"{html.FONT}.ttf").read_bytes() + b"x")
    monkeypatch.setattr(html, "font_folder", lambda: tmp_path)
    html.html_page(document())
    assert [sorted(letters - set("<svg>/")) for letters in cut] == [["a", "b"], ["x", "y", "z"], ["a", "b"]]
