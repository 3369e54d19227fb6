"""The chapter on how to read the report: its terms, from glossary.toml."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from harness.metrics import shown_in
from harness.report import formats
from harness.report.blocks import SYMBOLS, Chapter, Term, Terms
from harness.report.headline import Pair, false_alarms, judged_pairs
from harness.report.inputs import Inputs
from harness.report.tables import EXPECTED_SLOPE
from harness.report.texts import filled, read
from harness.scene.strategies import TABLE
from harness.stats.tiles import LARGER, PATCH

PLACE = 10
TITLE, ANCHOR = "How to read this", "reading"
_GLOSSARY = "glossary.toml"


def chapters(inputs: Inputs) -> Iterator[Chapter]:
    """The chapter, with the rate of false alarms of these verdicts."""
    yield Chapter(TITLE, ANCHOR, (Terms(glossary(judged_pairs(inputs.results))),))


def glossary(judged: Sequence[Pair]) -> tuple[Term, ...]:
    """Every term with its meaning, lines joined and gaps filled; metrics that have none, from their registry."""
    marks: dict[str, str] = {str(name): symbol for name, symbol in SYMBOLS.items()}
    gaps = {**marks, "larger": formats.fraction(LARGER), "patch": formats.share(PATCH),
            "slope": formats.fraction(EXPECTED_SLOPE),
            "strategies": "; ".join(f"{each.name}, {each.sentence}" for each in TABLE),
            "rate": formats.percent(false_alarms(judged), decimals=1)}
    terms: list[Term] = []
    held = read(_GLOSSARY)["term"]
    for term in held:
        if term["name"] == "metrics":
            terms += [Term(metric.heading, " ".join(filter(None, (
                formats.sentence(metric.sentence), metric.explanation, f"{metric.better.capitalize()} is better."))))
                for metric in shown_in("report") if metric.heading not in {each["name"] for each in held}]
        else:
            terms.append(Term(term["name"], filled(term["meaning"], gaps, _GLOSSARY)))
    return tuple(terms)
