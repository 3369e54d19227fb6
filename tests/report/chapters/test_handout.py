"""The chapter on the handout's pictures: what was kept, and what each took."""

from __future__ import annotations

import dataclasses
import io

import numpy as np
from PIL import Image

from harness.report import Inputs
from harness.report.blocks import Paragraph, Pictures
from harness.report.chapters.handout import chapters
from harness.report.document import compose
from harness.report.pages.html import html_page
from harness.report.pages.typst import typeset
from harness.results import KeptPicture
from tests.support.blocks import blocks
from tests.support.report import exact_study

RECORD = KeptPicture("course_scene", "mixture", 1024, 1024, 20_000, 20_000, 0, 5400.0, "llvmpipe", "2026-11-28")


def jpeg() -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(np.full((8, 8, 3), 90, dtype=np.uint8)).save(buffer, format="JPEG")
    return buffer.getvalue()


def test_nothing_comes_of_nothing() -> None:
    assert not list(chapters(Inputs([exact_study()], "quick")))


def test_each_picture_is_shown_large_with_its_count_and_what_it_took() -> None:
    inputs = Inputs([exact_study()], "quick", pictures=[(RECORD, jpeg())])
    chapter, = chapters(inputs)
    words, = blocks(chapter, Paragraph)
    assert "course_scene, 1,024" in words.text and "20,000 samples per pixel by mixture" in words.text
    assert "90.0\xa0min of llvmpipe (2026-11-28)" in words.text
    shown, = blocks(chapter, Pictures)
    assert shown.large and shown.rows[0].pictures[0].file.name == "course_scene.jpg"
    document = compose(inputs)
    assert "data:image/jpeg;base64," in html_page(document)
    assert typeset(document).startswith(b"%PDF")


def test_fewer_samples_than_the_handouts_are_told() -> None:
    inputs = Inputs([exact_study()], "quick", pictures=[(dataclasses.replace(RECORD, spp=256), jpeg())])
    words, = blocks(next(iter(chapters(inputs))), Paragraph)
    assert "256 of the handout's 20,000 samples per pixel by mixture" in words.text
