"""The notebook among the examples runs afresh, and shows what it was kept with."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from tests.support.notebook import executed

NOTEBOOK = Path(__file__).parent / "parameter_study.ipynb"


def shown(book: dict[str, Any]) -> list[dict[str, str]]:
    """By the kind of what it is, all that the cells print and show."""
    return [{kind: "".join(text) for kind, text in output.get("data", {"printed": output.get("text", [])}).items()}
            for cell in book["cells"] if cell["cell_type"] == "code" for output in cell["outputs"]]


def test_a_notebook_of_a_parameter_study_shows_what_it_did(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Charts, tables and numbers: what is measured in seconds is another number every time, pixels are not."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    kept, now = shown(json.loads(NOTEBOOK.read_text(encoding="utf-8"))), shown(executed(NOTEBOOK))
    assert [set(each) for each in kept] == [set(each) for each in now]
    assert sum("image/svg+xml" in each for each in now) == 3
    assert all(each["image/svg+xml"].startswith("<?xml") for each in now if "image/svg+xml" in each)
    table = now[0]["text/html"]
    assert table.count("<td>pass</td>") == 6 and "<th>variance × time</th>" in table
    before, after = ([float(number) for number in re.findall(r"[\d.]+", each["printed"])]
                     for shown_now in (kept, now) for each in shown_now if "printed" in each)
    assert after == pytest.approx(before, rel=0.1) and len(after) == 6


def test_the_notebook_is_one_that_jupyter_reads() -> None:
    """Of the fourth format, every cell with a name of its own, without what a failed run would leave."""
    book = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert (book["nbformat"], book["metadata"]["kernelspec"]["language"]) == (4, "python")
    assert len({cell["id"] for cell in book["cells"]}) == len(book["cells"])
    assert {output["output_type"] for cell in book["cells"] for output in cell.get("outputs", [])} == {
        "stream", "execute_result"}
    assert NOTEBOOK.stat().st_size < 300_000
