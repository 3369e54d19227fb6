"""Texts of chapters that are more words than numbers: TOML with gaps for numbers, and citations by number.

A text is a list of `[[block]]`, each with one of `heading`, `formula`, `table` (ignored here) or `text`, which may have
a `lead`. Blank lines part paragraphs. `{name}` is a gap, which the chapter fills with what it computed; `[hall1992]`
cites a work of chapters/references.toml, and becomes its number. So no number is typed into a text.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from harness.errors import HarnessError
from harness.report.blocks import Block, CrossReference, Formula, Heading, Paragraph, Work

FOLDER = Path(__file__).parent / "chapters"
_CITATION = re.compile(r"\[([a-z]+\d{4})\]")


def read(name: str) -> dict[str, Any]:
    """The TOML file of that name in `chapters/`."""
    return tomllib.loads((FOLDER / name).read_text(encoding="utf-8"))


@cache
def works() -> dict[str, Work]:
    """The works of references.toml by their keys, numbered in their order."""
    listed = read("references.toml")["work"]
    return {each["id"]: Work(number, f"work-{each['id']}", one_line(each["text"]))
            for number, each in enumerate(listed, start=1)}


def prose(name: str, values: Mapping[str, str]) -> Iterator[Block]:
    """The blocks of a text. HarnessError for a gap without a value, and for a work that is not listed."""
    for each in read(name)["block"]:
        if "heading" in each:
            yield Heading(each["heading"])
        elif "formula" in each:
            yield Formula(one_line(each["formula"]))
        else:
            lead = each.get("lead", "")
            for part in re.split(r"\n\s*\n", each["text"]):
                yield paragraph(filled(part, values, name), lead)
                lead = ""


def paragraph(text: str, lead: str = "") -> Paragraph:
    """Running text whose citations are numbers that lead to their works."""
    cited = {key: _work(key) for key in _CITATION.findall(text)}
    for key, work in cited.items():
        text = text.replace(f"[{key}]", f"[{work.number}]")
    return Paragraph(text, lead, tuple(CrossReference(f"[{work.number}]", work.anchor) for work in cited.values()))


def filled(text: str, values: Mapping[str, str], name: str) -> str:
    """A text on one line with its gaps filled."""
    try:
        return one_line(text).format_map(values)
    except KeyError as error:
        raise HarnessError(f"{name} has a gap {{{error.args[0]}}}, for which its chapter has no value") from None


def one_line(text: str) -> str:
    """A text without its line breaks."""
    return re.sub(r"[ \n]+", " ", text).strip()


def _work(key: str) -> Work:
    if key not in works():
        raise HarnessError(f"a text cites '{key}', which is not among the works of chapters/references.toml")
    return works()[key]
