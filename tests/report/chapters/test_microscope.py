"""The chapter on the coupled oracle: its table, its maps and the autopsies' score, in the PDF and in the page alike."""

from __future__ import annotations

import dataclasses

import numpy as np

from harness.report import Inputs, formats
from harness.report.blocks import Chapter, Paragraph, Pictures, Remarks, Table
from harness.report.chapters.microscope import ANCHOR, MAPS, TITLE, chapters
from harness.report.document import compose
from harness.report.pages.html import html_page
from harness.report.pages.typst import typeset
from harness.results import Acquitted, AutopsyScore, CoupledRecord, NamedMutant
from harness.studies.oracle import OracleFile, OracleRecord, OracleTiles
from tests.support.blocks import blocks
from tests.support.report import exact_study

RECORD = CoupledRecord("furnace_convex", "mixture", 16, 8, 2.4e5, (1e-6, -2e-6, 4e-6), 3000, 30, 0, 1.25,
                       np.random.default_rng(1).normal(size=(12, 16)) * 1e-5)
SCORE = AutopsyScore(
    (NamedMutant("a1", "a", "lib/a.glsl", ("f",), "named", "spheres", "mixture", "hit", ("f",), "lib/a.glsl:3", 1, 0.5),
     NamedMutant("a2", "a", "lib/a.glsl", ("f",), "misnamed", "spheres", "mixture", "hit", ("g",), "", 1, 1.5),
     NamedMutant("b1", "b", "lib/b.glsl", ("h",), "missed"), NamedMutant("b2", "b", "lib/b.glsl", ("h",), "unreached")),
    (Acquitted("ours", "spheres", "mixture", "", ()), Acquitted("other", "spheres", "mixture", "", ())))
ORACLE = OracleFile("2026-11-28", {"mitsuba": "3.9.1", "drjit": "1.5.0"}, (OracleRecord(
    "spheres", "mixture", (48, 36), (4096, 2048), (2e-5, -4e-5, 8e-5), OracleTiles(0.7, 3.5, 2e-4),
    OracleTiles(-2.1, 4.3, 2e-3), OracleTiles(3.0, 4.9, 0.015), 100.0, True),))


def chapter(*records: CoupledRecord, score: AutopsyScore | None = None) -> Chapter:
    found, = chapters(Inputs([exact_study()], "quick", coupled=records, autopsies=score))
    return found


def test_nothing_comes_of_nothing() -> None:
    assert not list(chapters(Inputs([exact_study()], "quick")))


def test_a_row_a_pair_with_its_units() -> None:
    """What none of N samples showed lies below 3/N; no noise, no ratio."""
    quiet = dataclasses.replace(RECORD, strategy="uniform", ratio=np.nan, differing=0)
    table, = blocks(chapter(RECORD, quiet), Table)
    first, second = ([cell.text.replace(formats.NBSP, " ") for cell in row] for row in table.rows)
    assert first == ["furnace_convex", "mixture", "240,000", "1.0 %", "< 0.1 %", "+1.0 [−2.0, +4.0]", "16 × 8", "1.2"]
    assert second[:3] == ["uniform", formats.MISSING, "< 0.1 %"]
    assert table.rows[0][0].rows == 2 and table.rules == (0,)


def test_a_mean_that_is_off_is_named_and_so_is_a_scene_left_out() -> None:
    off = dataclasses.replace(RECORD, error=(3e-6, 1e-6, 5e-6))
    told = [remark.text.replace(formats.NBSP, " ") for remark in blocks(chapter(off), Remarks)[0].items]
    assert told[0].startswith("In 0 of 1 pair of scene and strategy") and "furnace_convex mixture" in told[0]
    inputs = Inputs([exact_study(), dataclasses.replace(exact_study(), scene="far")], "quick", coupled=[RECORD])
    remarks = blocks(next(chapters(inputs)), Remarks)[0].items
    assert remarks[-1].mark == "warning" and remarks[-1].text.endswith(": far.")


def test_maps_are_of_the_scenes_in_which_most_is_left() -> None:
    names = [f"s{number}" for number in range(MAPS + 2)]
    study = exact_study()
    records = [dataclasses.replace(RECORD, scene=name, ratio=10.0 * (number + 1) if number else np.nan)
               for number, name in enumerate(names)]
    inputs = Inputs([dataclasses.replace(study, scene=name) for name in names], "quick", coupled=records)
    shown = blocks(next(chapters(inputs)), Pictures)[0]
    titles = [picture.title for row in shown.rows for picture in row.pictures]
    assert titles == [f"{name}, mixture" for name in names[1:MAPS + 1]]
    bars = [picture.bar for row in shown.rows for picture in row.pictures]
    assert all(bar and "×10⁻" in bar.labels[2] for bar in bars)


def test_autopsies_are_counted_by_part_and_those_that_are_wrong_named() -> None:
    found = chapter(score=SCORE)
    rows = [[cell.text for cell in row] for row in blocks(found, Table)[0].rows]
    assert [row[:6] for row in rows] == [
        ["a", "2", "1", "1", "–", "–"], ["b", "2", "–", "–", "1", "1"], ["all", "4", "1", "1", "1", "1"]]
    told = [(remark.mark, remark.text.replace(formats.NBSP, " ")) for remark in blocks(found, Remarks)[0].items]
    assert told[0] == ("", "1 of 3 mutants that change a path are named by the right function first (33.3 %).")
    assert told[1] == ("warning", "Another function is named: a2 (g for f).")
    assert [text for _, text in told[2:4]] == ["Nothing is accused: b1.", "No scene shows: b2."]
    assert told[4][0] == "pass" and told[4][1].startswith("Of 2 right shaders, examined 2 times on 1 pair of scene")
    accused = dataclasses.replace(SCORE, variants=(Acquitted("other", "spheres", "lobes", "normal", ()),))
    last = blocks(chapter(score=accused), Remarks)[0].items[-1]
    assert last.mark == "fail" and "other on spheres (normal)" in last.text


def test_the_oracle_is_shown_with_its_date_and_what_it_could_not_have_missed() -> None:
    found, = chapters(Inputs([exact_study()], "quick", oracle=ORACLE))
    text, = blocks(found, Paragraph)
    assert "for 100 s of CPU time, on 2026-11-28, with mitsuba 3.9.1 and drjit 1.5.0" in text.text.replace("\xa0", " ")
    row, = ([cell.text.replace(formats.NBSP, " ") for cell in row] for row in blocks(found, Table)[0].rows)
    assert row == ["spheres", "mixture", "4,096", "2,048", "+20.0 [−40.0, +80.0]", "+0.7 [3.5]", "−2.1 [4.3]",
                   "+3.0 [4.9]", "0.20 %", "1.5 %"]
    remark, = blocks(found, Remarks)[0].items
    assert remark.mark == "pass" and "each mean is within 0.0080 %" in remark.text.replace("\xa0", " ")
    apart = dataclasses.replace(ORACLE, records=(dataclasses.replace(ORACLE.records[0], agrees=False),))
    found, = chapters(Inputs([exact_study()], "quick", oracle=apart))
    remark, = blocks(found, Remarks)[0].items
    assert remark.mark == "fail" and remark.text.endswith("explains: spheres.")


def test_it_stands_in_the_pdf_and_in_the_page() -> None:
    document = compose(Inputs([exact_study()], "quick", coupled=[RECORD], autopsies=SCORE, oracle=ORACLE))
    assert typeset(document).startswith(b"%PDF")
    page = html_page(document)
    assert f'id="{ANCHOR}"' in page and TITLE in page and "Autopsies" in page and "The oracle itself" in page
