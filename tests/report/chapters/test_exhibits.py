"""The chapter on the handout's errors: every word, number and picture of an exhibit reaches both pages."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
import typst

from harness.files import data_dir
from harness.report import Inputs
from harness.report.blocks import Chapter, Curves, Document, Pictures, Table
from harness.report.chapters.exhibits import ANCHOR, TITLE, chapters
from harness.report.document import compose
from harness.report.pages.html import html_page
from harness.results import Exhibit, ExhibitImage, Finding, Plot, Series, StudyResult
from tests.support.blocks import blocks
from tests.support.report import exact_study

RNG = np.random.default_rng(1)
RENDER = RNG.random((12, 16, 3))
MAP = RNG.normal(size=(12, 16)) * 0.02
LINE = Series("handout", False, np.geomspace(1, 100, 8), np.geomspace(1, 0.1, 8))
EXHIBIT = Exhibit(
    "first", "A pdf over <π²>", "course/first.glsl", "a / (PI * PI)\nb < c", "a / (2 * PI)", "-57 % of it",
    "Too bright by -57 % & more.", "Integrate it.",
    (Finding("pdf integral", "kept: ∫ pdf", 0.637, 1.0, "number", True, True),
     Finding("mean error", "kept: image", -0.0044, 0.0001, "error", True, False),
     Finding("distinct values", "share", 0.65, 0.0001, "share", True, True),
     Finding("finite samples", "lost", 1081287, 0, "count", False, True),
     Finding("compilation", "the tracer", "does not compile", "compiles", "words", True, True)),
    (ExhibitImage("Handout", RENDER), ExhibitImage("Ours", RENDER), ExhibitImage("Map", MAP, "relative")),
    (Plot("RMSE", "passes", "xy", (LINE, dataclasses.replace(LINE, name="ours", ours=True))),
     Plot("B", "x", "", (LINE,))),
    message="course/first.glsl:3: no")
MAPS = dataclasses.replace(
    EXHIBIT, id="second", title="Noise", file="", message="", plots=(), findings=EXHIBIT.findings[:1],
    images=(ExhibitImage("One", 200 * MAP, "deviations"), ExhibitImage("Two", MAP, "deviations")))
BARE = dataclasses.replace(MAPS, id="third", title="Words", images=())


def chapter(*exhibits: Exhibit) -> Chapter:
    found, = chapters(Inputs([exact_study()], "quick", exhibits=exhibits))
    return found


def composed(study: StudyResult, *exhibits: Exhibit) -> Document:
    return compose(Inputs([study], "quick", exhibits=exhibits))


def test_without_exhibits_there_is_no_chapter(study: StudyResult) -> None:
    assert not list(chapters(Inputs([study], "quick")))
    assert TITLE not in html_page(composed(study))


def test_the_chapter_is_set_without_a_warning(study: StudyResult, tmp_path: Path) -> None:
    """A chapter of its own with one section an exhibit, on paper."""
    document = composed(study, EXHIBIT, MAPS, BARE)
    for name, content in document.assets().items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "report.json").write_text(document.json(), encoding="utf-8")
    (tmp_path / "main.typ").write_bytes((data_dir("reports") / "report.typ").read_bytes())
    settings: dict[str, Any] = {"root": str(tmp_path), "font_paths": [f"{matplotlib.get_data_path()}/fonts/ttf"],
                                "ignore_system_fonts": True}
    main = str(tmp_path / "main.typ")
    _, warnings = typst.compile_with_warnings(main, **settings)
    assert not warnings
    headings = [item["text"] for item in json.loads(typst.query(main, "heading", field="body", **settings))]
    at = headings.index(TITLE)
    assert headings[at + 1:at + 4] == [EXHIBIT.title, "Noise", "Words"]
    assert at < headings.index("Provenance")
    kinds = json.loads(typst.query(main, "figure", field="kind", **settings))
    assert kinds.count("image") == (2 + 3) + 2 + 1 + 1, "gains, features, scene; pictures and curves; maps; deviates"
    assert kinds.count("table") == (1 + 1 + 3 + 3 + 1) + 1 + 3, "without the chapter; overview; findings"


def test_the_page_holds_every_word(study: StudyResult) -> None:
    """Code escaped and unwrapped, the compiler's message, effect and advice, each number in its unit."""
    page = html_page(composed(study, EXHIBIT, MAPS))
    for words in ("<pre>a / (PI * PI)\nb &lt; c</pre>", "course/first.glsl:3: no",
                  "Too bright by −57\u00a0% &amp; more.", "Integrate it.", f'href="#{ANCHOR}"',
                  'href="#exhibit-first"', 'id="exhibit-first"', "0.637", "−0.440\u00a0%", "65\u00a0%", "1,081,287",
                  "does not compile", "glsl/course/first.glsl"):
        assert words in page
    assert page.count("A pdf over &lt;π²&gt;") >= 2


def test_the_overview_tells_what_found_an_error_and_what_did_not() -> None:
    first, second = blocks(chapter(EXHIBIT, MAPS), Table)[0].rows
    assert [cell.text for cell in first] == [
        EXHIBIT.title, "−57\u00a0% of it", "pdf integral, mean error, distinct values, compilation", "finite samples",
        "fail"]
    assert second[-1].mark == "pass" and second[2].text == "pdf integral"


def test_findings_are_marked_by_who_noticed() -> None:
    """✗ where the check objects to the handout's formula; ours is ✓, or ✗ where a check objects to it."""
    table = blocks(chapter(EXHIBIT), Table)[1]
    assert [(row[2].mark, row[3].mark) for row in table.rows] == [
        ("fail", "pass"), ("fail", "fail"), ("fail", "pass"), ("", "pass"), ("fail", "pass")]
    assert table.rules == (0,)


def test_one_map_stands_beside_the_renders_and_several_below_on_one_scale() -> None:
    first, second = blocks(chapter(EXHIBIT, MAPS), Pictures)
    assert [picture.title for row in first.rows for picture in row.pictures] == ["Handout", "Ours", "Map"]
    assert first.rows[0].pictures[2].bar and "%" in first.rows[0].pictures[2].bar.labels[2]
    assert len(second.rows) == 1 and second.rows[0].bar and second.rows[0].bar.labels[2] == "+3\u00a0σ"
    files = [picture.file for figure in (first, second) for row in figure.rows for picture in row.pictures]
    assert len({file.name for file in files}) == 5 and all(file.content.startswith(b"\x89PNG") for file in files)


def test_curves_are_told_apart_in_the_caption() -> None:
    found = chapter(EXHIBIT, BARE)
    curves, = blocks(found, Curves)
    assert curves.caption.endswith("Orange triangles: handout. Blue dots: ours.")
    svg = curves.file.content.decode()
    assert all(f">{text}<" in svg for text in ("RMSE", "passes", "B", "x"))
    assert len(blocks(found, Pictures)) == 1, "words alone have no pictures"


@pytest.mark.parametrize("field", ["title", "handout", "right", "effect", "advice"])
def test_a_changed_word_changes_the_page(study: StudyResult, field: str) -> None:
    changed = dataclasses.replace(BARE, **{field: "Something else."})
    assert "Something else." in composed(study, changed).json()
