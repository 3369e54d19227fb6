"""No number of the report is typed: what its chapters say in words holds no digit but in formulas and names.

Numbers come into sentences through gaps, from what was measured or from the constants that code is held to.
"""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from harness.report.texts import FOLDER

REPORT = FOLDER.parent
# Where sentences are made; figures and pages hold sizes in centimetres, and no sentences.
SOURCES = [*sorted(FOLDER.glob("*.py")), *(REPORT / f"{name}.py" for name in ("bars", "headline", "suite", "tables",
                                                                              "tiles"))]
# Texts; of references.toml all is a citation, whose years and volumes are its own.
TEXTS = [path for path in sorted(FOLDER.glob("*.toml")) if path.name != "references.toml"]
# What may hold a digit, as it stands: formulas, and names.
ALLOWED = ("N(0, 1)", "1/√N", "1 − SSIM", "1 / (variance", "Mitsuba 3")
# Keys of texts that hold no words for a reader.
NOT_SAID = {"id", "code", "topic", "part", "formula", "crop", "scene", "strategies"}
CITATION = re.compile(r"\[[a-z]+\d{4}\]")
TYPED = re.compile(r"\d|\b(?:dozen|hundred|thousand|cent|mille)s?\b", re.IGNORECASE)


def typed(text: str) -> str:
    """The first number in a text that is neither of a formula nor a name, with what stands around it; or nothing."""
    for allowed in ALLOWED:
        text = text.replace(allowed, "")
    text = CITATION.sub("", re.sub(r"\{[^{}]*\}", "", text))
    found = TYPED.search(text)
    is_said = re.search(r"[^\W\d_]{3}", text) is not None  # the end of a scale, an empty cell: no words
    return text[max(0, found.start() - 20):found.end() + 20] if found and is_said else ""


def said(path: Path) -> Iterator[tuple[int, str]]:
    """What a module may print: its string literals with their lines, without docstrings, formats and encodings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    silent: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef) and ast.get_docstring(node, clean=False):
            silent.add(id(node.body[0].value))  # type: ignore[attr-defined]
        if isinstance(node, ast.FormattedValue) and node.format_spec:
            silent |= {id(part) for part in ast.walk(node.format_spec)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in silent:
            yield node.lineno, node.value


def literals(path: Path) -> Iterator[tuple[int, str]]:
    """Calls of `formats` that print a number which stands there as a literal."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
                and isinstance(node.func.value, ast.Name) and node.func.value.id == "formats" and node.args
                and isinstance(node.args[0], ast.Constant) and isinstance(node.args[0].value, int | float)):
            yield node.lineno, ast.unparse(node)


def words(value: Any, key: str = "") -> Iterator[str]:
    """All strings of a text that a reader sees."""
    if isinstance(value, dict):
        for name, each in value.items():
            yield from words(each, name)
    elif isinstance(value, list):
        for each in value:
            yield from words(each, key)
    elif isinstance(value, str) and key not in NOT_SAID:
        yield value


def test_no_chapter_types_a_number() -> None:
    assert len(SOURCES) > 15
    found = [f"{path.name}:{line}: {wrong}" for path in SOURCES for line, text in said(path) if (wrong := typed(text))]
    found += [f"{path.name}:{line}: {call}" for path in SOURCES for line, call in literals(path)]
    assert not found, "take these numbers from what was measured, or from the constant that they repeat"


def test_no_text_types_a_number() -> None:
    assert len(TEXTS) > 5
    found = [f"{path.name}: {wrong}" for path in TEXTS
             for text in words(tomllib.loads(path.read_text(encoding="utf-8"))) if (wrong := typed(text))]
    assert not found, "make these numbers gaps, which the chapter fills"


def test_what_is_allowed_is_used() -> None:
    everything = "".join(path.read_text(encoding="utf-8") for path in (*SOURCES, *TEXTS))
    assert not [allowed for allowed in ALLOWED if allowed not in everything]


@pytest.mark.parametrize("text", ["in tiles of 1/5 of its side", "95 % of them", "a hundred times", "within 0.2"])
def test_a_typed_number_is_found(text: str) -> None:
    assert typed(text)


@pytest.mark.parametrize("text", ["{rate} of pixels", "as in [hall1992], {a}", "falls as 1/√N", "density N(0, 1)", "0"])
def test_a_gap_a_citation_and_a_formula_are_none(text: str) -> None:
    assert not typed(text)
