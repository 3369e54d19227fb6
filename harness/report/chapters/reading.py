"""The chapter on how to read the report: its terms, from glossary.toml."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

from harness.metrics import shown_in
from harness.report import formats
from harness.report.blocks import SYMBOLS, Chapter, Term, Terms
from harness.report.inputs import Inputs

PLACE = 10
TITLE, ANCHOR = "How to read this", "reading"
_GLOSSARY = Path(__file__).with_name("glossary.toml")


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, the same for all inputs."""
    yield Chapter(TITLE, ANCHOR, (Terms(glossary()),))


def glossary() -> tuple[Term, ...]:
    """Every term with its meaning, lines joined and marks in place; metrics that have none, from their registry."""
    terms: list[Term] = []
    held = tomllib.loads(_GLOSSARY.read_text(encoding="utf-8"))["term"]
    for term in held:
        if term["name"] == "metrics":
            terms += [Term(metric.heading, " ".join(filter(None, (
                formats.sentence(metric.sentence), metric.explanation, f"{metric.better.capitalize()} is better."))))
                for metric in shown_in("report") if metric.heading not in {each["name"] for each in held}]
        else:
            terms.append(Term(term["name"], " ".join(term["meaning"].format_map(SYMBOLS).split("\n")).strip()))
    return tuple(terms)
