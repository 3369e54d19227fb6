"""Grades as files: a table of all (CSV, HTML), and for each submission a page and what Gradescope reads."""

from __future__ import annotations

import csv
import datetime
import io
import json
import re
from collections.abc import Iterator, Sequence
from typing import Any

from harness.grading.records import Graded, Hints, told
from harness.report.blocks import (
    Asset,
    Block,
    Cell,
    Chapter,
    Column,
    Document,
    Facts,
    Heading,
    Mark,
    Paragraph,
    Picture,
    PictureRow,
    Pictures,
    Remark,
    Remarks,
    Table,
)
from harness.report.figures.pictures import BRIGHTER, DARKER
from harness.report.pages.html import html_page
from harness.samples.json import plain

CSV_FILE, INDEX_FILE, PAGE_FILE, GRADESCOPE_FILE = "grades.csv", "index.html", "index.html", "results.json"
HEADER = ("name", "outcome", "points", "error", "low", "high", "sentence", "place", "family", "formula", "findings",
          "seconds")
# Sheets of a spreadsheet take what begins so for a formula; a student's file may be called anything.
_FORMULA = re.compile(r"^[=+\-@\t\r]")
_MARKS: dict[str, Mark] = {"pass": "pass", "fail": "fail", "inconclusive": "inconclusive", "refused": "warning"}


def sheets(grades: Sequence[Graded], *, scene: str, hints: Hints, points: float) -> dict[str, bytes]:
    """All files by their path in the output folder.

    The table is the teacher's and tells everything; pages and Gradescope's files are the students' and tell what
    `hints` allow. `points`: what a submission that is right is worth.
    """
    files = {CSV_FILE: _csv(grades, points).encode(), INDEX_FILE: html_page(_table(grades, scene, points)).encode()}
    for graded in grades:
        seen = told(graded, hints)
        files[f"{graded.name}/{PAGE_FILE}"] = html_page(_page(seen, scene, points)).encode()
        files[f"{graded.name}/{GRADESCOPE_FILE}"] = _json(gradescope(seen, points))
    return files


def gradescope(graded: Graded, points: float) -> dict[str, Any]:
    """What an autograder hands to Gradescope (its documentation, "Autograder specifications", results.json)."""
    whole = sum(part.share for part in graded.parts)
    tests = [{"name": part.name, "score": round(points * part.share * part.earned / whole, 2),
              "max_score": round(points * part.share / whole, 2), "output": part.sentence,
              "status": "passed" if part.earned == 1 else "failed"} for part in graded.parts]
    return {"score": round(points * graded.points, 2), "output": "\n".join(_lines(graded)),
            "execution_time": round(graded.seconds, 1), "tests": tests}


def _json(value: object) -> bytes:
    return (json.dumps(plain(value), indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def _lines(graded: Graded) -> Iterator[str]:
    """What there is to say of a submission, a sentence a line."""
    yield graded.sentence
    yield from (text for text in (graded.place, graded.family, graded.formula) if text)
    yield from (text for _, text in graded.findings)


def _csv(grades: Sequence[Graded], points: float) -> str:
    buffer = io.StringIO()
    writer = csv.writer(buffer)
    writer.writerow(HEADER)
    for each in grades:
        low, error, high = each.error or ("", "", "")
        row = (each.name, each.outcome, round(points * each.points, 2), error, low, high, each.sentence, each.place,
               each.family, each.formula, " | ".join(text for _, text in each.findings), round(each.seconds, 1))
        writer.writerow([f"'{cell}" if isinstance(cell, str) and _FORMULA.match(cell) else cell for cell in row])
    return buffer.getvalue()


def _table(grades: Sequence[Graded], scene: str, points: float) -> Document:
    rows = tuple((Cell(each.name), Cell(each.outcome, _MARKS[each.outcome]), Cell(f"{points * each.points:.4g}"),
                  Cell(_error(each)), Cell(_said(each)))
                 for each in grades)
    columns = (Column("submission"), Column("verdict"), Column("points", "right"), Column("mean error", "right"),
               Column("what there is to say", share=1.0))
    counts = {outcome: sum(each.outcome == outcome for each in grades) for outcome in _MARKS}
    passed = ", ".join(f"{count} {outcome}" for outcome, count in counts.items() if count)
    chapter = Chapter("", "grades", (
        Paragraph(f"{len(grades)} submissions against the scene {scene}: {passed}. Each has a page in the folder of "
                  "its name."), Table("All submissions.", columns, rows, long=True)))
    return Document("Grades", f"scene {scene}", _today(), (chapter,))


def _said(graded: Graded) -> str:
    """The cause as far as it is known; else what is wrong, and where."""
    return graded.formula or graded.family or "; ".join(text for text in (graded.sentence, graded.place) if text)


def _page(graded: Graded, scene: str, points: float) -> Document:
    """A page of evidence."""
    blocks: list[Block] = [Remarks((Remark(f"{graded.outcome}: {graded.sentence}", _MARKS[graded.outcome]),))]
    facts = [f"{points * graded.points:.4g} of {points:g} points", ", ".join(graded.files)]
    blocks.append(Facts((*facts, *([f"mean error {_error(graded)}"] if graded.error else []))))
    if said := [text for text in (graded.place, graded.family, graded.formula) if text]:
        blocks += [Heading("What is wrong"), *(Paragraph(text) for text in said)]
    if graded.findings:
        blocks += [Heading("Found without a reference"),
                   Remarks(tuple(Remark(text, "warning") for _, text in graded.findings))]
    if graded.pictures:
        row = tuple(Picture(Asset(f"{graded.name}-{number}.png", content), title, f"{title} of {graded.name}")
                    for number, (title, content) in enumerate(graded.pictures))
        blocks.append(Pictures(f"At one exposure; in the difference, {DARKER} is too dark and {BRIGHTER} too bright.",
                               (PictureRow(row),)))
    columns = (Column("part"), Column("points", "right"), Column("", share=1.0))
    whole = sum(part.share for part in graded.parts) or 1.0
    rows = tuple((Cell(part.name, "pass" if part.earned == 1 else "fail"),
                  Cell(f"{points * part.share * part.earned / whole:.4g} / {points * part.share / whole:.4g}"),
                  Cell(part.sentence)) for part in graded.parts)
    blocks.append(Table("How the points come together.", columns, rows))
    if graded.contract:
        blocks += [Heading("How it was run"), Paragraph(graded.contract)]
    return Document(graded.name, f"scene {scene}", _today(), (Chapter("", "verdict", tuple(blocks)),))


def _error(graded: Graded) -> str:
    if graded.error is None:
        return ""
    low, error, high = graded.error
    return f"{error:+.2%} ({low:+.2%} to {high:+.2%})"


def _today() -> str:
    now = datetime.datetime.now()
    return f"{now.day} {now:%B %Y}"
