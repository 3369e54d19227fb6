"""Every kind of block is set by every medium, and an author of chapters is told what is wrong with one."""

from __future__ import annotations

import io
import json
import re
import tempfile
from pathlib import Path

import numpy as np
import pytest
import typst
from PIL import Image

from harness.errors import HarnessError
from harness.files import data_dir
from harness.report.blocks import (
    KINDS,
    Asset,
    Bar,
    Block,
    Cell,
    Chapter,
    Column,
    CrossReference,
    Curves,
    Document,
    Facts,
    Formula,
    Heading,
    Link,
    Listing,
    Listings,
    Paragraph,
    Picture,
    PictureRow,
    Pictures,
    Pointer,
    Remark,
    Remarks,
    Swatch,
    Table,
    Term,
    Terms,
    Work,
    Works,
)
from harness.report.figures.svg import blank, svg
from harness.report.pages.html import html_page
from harness.report.pages.typst import TEMPLATE, typeset


def png(colour: int) -> bytes:
    buffer = io.BytesIO()
    Image.new("L", (2, 2), colour).save(buffer, "PNG")
    return buffer.getvalue()


DOT = Asset("dot.png", png(7))
BLOCKS: tuple[Block, ...] = (
    Heading("Section", "section"), Heading("Aside"), Paragraph("text <1>", lead="Lead."), Facts(("fact a", "fact b")),
    Paragraph("as [1] and [2] say", links=(CrossReference("[1]", "work-a"), CrossReference("[2]", "work-b"))),
    Formula("f(x) = x^2 / 3"),
    Works((Work(1, "work-a", "A. Author: a work"), Work(2, "work-b", "B. Author: another"))),
    Remarks((Remark("remark", "fail"), Remark("plain"))), Remarks((Remark("closer"),), small=True),
    Terms((Term("term", "meaning ✓"),)), Pointer("the other", "other"),
    Table("table", (Column("A", share=1), Column("B\nC", "right")),
          ((Cell("a_b", target="section"), Cell("2", "pass", links=(Link("its file", "a folder/b.png"),))),)),
    Table("long", (Column("A"),), ((Cell("long cell"),),) * 80, (1,), long=True),
    Pictures("pictures", (PictureRow((Picture(DOT, "title", "alt", Bar(DOT, ("low", "mid", "high"))),), "row"),)),
    Curves("curves", Asset("line.svg", svg(lambda: blank(4, 3), "line")), "a line", 4.0),
    Listings((Listing("Wrong", "a\nb", "fail"), Listing("Right", "c", "pass"))))


def document(*blocks: Block) -> Document:
    return Document("Report", "sub", "today", (
        Chapter("", "", blocks[:1]), Chapter("One", "one", blocks[1:]),
        Chapter("Other", "other", (Paragraph("the end"),), follows_on=True)))


def test_the_blocks_of_these_tests_are_of_every_kind() -> None:
    assert {type(block) for block in BLOCKS} == set(KINDS)


def test_both_media_set_every_kind() -> None:
    assert typeset(document(*BLOCKS)).startswith(b"%PDF")
    page = html_page(document(*BLOCKS))
    for words in ('<h3 id="section">Section</h3>', "<h3>Aside</h3>", "<p><b>Lead.</b> text &lt;1&gt;</p>", "fact b",
                  "remark", "closer", "<dt>term</dt>", 'href="#other"', "a_<wbr>b", "long cell", 'alt="alt"', "high",
                  'as <a href="#work-a">[1]</a> and <a href="#work-b">[2]</a> say', '<li id="work-a"><span>[1]</span>',
                  "<mi>f</mi>", '<a href="a%20folder/b.png">its file</a>', 'aria-label="a line"', "<pre>a\nb</pre>"):
        assert words in page
    assert re.findall(r'<nav><a href="#one">One</a><a href="#other">Other</a></nav>', page)


def test_a_table_that_is_too_wide_is_set_smaller() -> None:
    """Seen in a report: 'environment' ran into the marker beside it. White stands between them."""
    texts = ("131,072", "+0.031 % [−0.012, +0.190] %", "not suited", "±1.25 %", "±5 %", "−0.498 [−0.523, −0.471]",
             "not judged")
    wide = tuple(Column(f"{index}", "right") for index in range(len(texts)))
    rows = ((Cell("environment"), Cell("mixture sobol", swatch=Swatch("▼", "#ff0000")),
             *(Cell(text, "inconclusive") for text in texts)),) * 9
    files = {TEMPLATE: (data_dir("reports") / TEMPLATE).read_bytes(), "report.json": document(
        Heading("Section"), Table("wide", (Column("Scene", share=1), Column("Strategy"), *wide), rows)).json().encode()}
    image = _second_page(files)
    red = (image[..., 0] > 200) & (image[..., 1:] < 100).all(-1)
    lines, columns = np.nonzero(red)
    top, bottom, left = lines.min(), lines.max(), columns.min()
    assert (image[top:bottom, left - 8:left - 2] > 250).all()
    assert (image[top:bottom, :left] < 100).any(), "the names of the scenes"


def _second_page(files: dict[str, bytes]) -> np.ndarray:
    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            Path(folder, name).write_bytes(content)
        pages = typst.compile(str(Path(folder, TEMPLATE)), root=folder, ignore_system_fonts=True, format="png", ppi=144)
    return np.asarray(Image.open(io.BytesIO(pages[1])).convert("RGB"))


def test_the_template_has_a_function_for_every_kind_and_none_for_others() -> None:
    template = (data_dir("reports") / TEMPLATE).read_text(encoding="utf-8")
    table = template[template.index("#let kinds = ("):]
    assert set(re.findall(r"^  (\w+): ", table[:table.index("\n)")], re.MULTILINE)) == {kind.__name__ for kind in KINDS}


def test_the_json_names_kinds_and_files() -> None:
    chapters = json.loads(document(*BLOCKS).json())["chapters"]
    assert [block["kind"] for block in chapters[1]["blocks"]] == [type(block).__name__ for block in BLOCKS[1:]]
    assert [block["file"] for block in chapters[1]["blocks"] if block["kind"] == "Curves"] == ["line.svg"]


def test_pictures_are_found_wherever_they_stand_and_may_be_shown_twice() -> None:
    assert document(*BLOCKS, *BLOCKS).assets().keys() == {"dot.png", "line.svg"}


def test_two_pictures_of_one_name_are_refused() -> None:
    other = Pictures("other", (PictureRow((Picture(Asset("dot.png", png(8)), "", "alt"),)),))
    with pytest.raises(HarnessError, match=r"two different figures of a report are called 'dot\.png'; give each"):
        document(*BLOCKS, other).assets()


def test_the_links_to_chapters_wrap() -> None:
    """Seen at 1200 pixels: without a place to break, the links of twenty chapters ran off the page."""
    sheet = (Path(__file__).parents[2] / "harness" / "report" / "pages" / "report.css").read_text(encoding="utf-8")
    rule = re.search(r"^nav \{([^}]*)\}", sheet, re.MULTILINE)
    assert rule and "display: flex" in rule[1] and "flex-wrap: wrap" in rule[1]
