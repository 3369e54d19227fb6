"""A page in French, since the course is: what was proved, how, and the results, with the abstract's numbers."""

from __future__ import annotations

from collections.abc import Iterator

from harness.report import formats
from harness.report.blocks import Chapter
from harness.report.chapters.abstract import TEXT
from harness.report.headline import headline
from harness.report.inputs import Inputs
from harness.report.texts import filled, one_line, paragraph, read

PLACE = 5
TITLE, ANCHOR = "Résumé en français", "resume"


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The page; a paragraph of which nothing was measured is left out."""
    told = {topic: {name: formats.french(number) for name, number in numbers.items()}
            for topic, numbers in headline(inputs).items()}
    sentences: dict[str, list[str]] = {}
    for each in read(TEXT)["sentence"]:
        if each["topic"] in told:
            sentences.setdefault(each["part"], []).append(filled(each["fr"], told[each["topic"]], TEXT))
    blocks = []
    for each in read("resume.toml")["paragraph"]:
        text = " ".join(filter(None, (one_line(each["text"]), *sentences.get(each["part"], ()))))
        if text:
            blocks.append(paragraph(_spaced(text), each["lead"]))
    yield Chapter(TITLE, ANCHOR, tuple(blocks), language="fr")


def _spaced(text: str) -> str:
    """Spaces before double punctuation and inside quotation marks that no line breaks at, as French has them."""
    for mark in (":", ";", "?", "!", "»"):
        text = text.replace(f" {mark}", f"{formats.NBSP}{mark}")
    return text.replace("« ", f"«{formats.NBSP}")
