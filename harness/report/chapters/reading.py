"""The chapter on how to read the report: its terms, from glossary.toml."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

from harness.report.blocks import SYMBOLS, Chapter, Term, Terms
from harness.report.inputs import Inputs

PLACE = 10
TITLE, ANCHOR = "How to read this", "reading"
_GLOSSARY = Path(__file__).with_name("glossary.toml")


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, the same for all inputs."""
    yield Chapter(TITLE, ANCHOR, (Terms(glossary()),))


def glossary() -> tuple[Term, ...]:
    """Every term with its meaning, lines joined and marks in place."""
    terms = tomllib.loads(_GLOSSARY.read_text(encoding="utf-8"))["term"]
    return tuple(Term(term["name"], " ".join(term["meaning"].format_map(SYMBOLS).split("\n")).strip())
                 for term in terms)
