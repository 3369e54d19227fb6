"""`harness check-library`: what it prints, and its exit status."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.checks import own
from harness.files import data_dir
from tests.cli.conftest import Harness, refusal


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """One topic in place of four."""
    monkeypatch.setattr(own, "TOPICS", {"random numbers": own.TOPICS["random numbers"]})


def library(line: str = "", replacement: str = "") -> Path:
    """A folder with a lib/random.glsl, ours but for a line."""
    folder = Path("mine") / "lib"
    folder.mkdir(parents=True)
    text = (data_dir("glsl") / "lib" / "random.glsl").read_text(encoding="utf-8")
    (folder / "random.glsl").write_text(text.replace(line, replacement) if line else text, encoding="utf-8")
    return folder.parent


def test_a_library_that_is_right(harness: Harness) -> None:
    done = harness("check-library", library())
    assert (done.status, done.err) == (0, "")
    assert done.out == "11 checks of rand, seed_sample, pixel_stream: all passed\n"


def test_one_that_is_not_is_told_by_function_and_line(harness: Harness) -> None:
    folder = library("pcg_hash(pixel.x + pcg_hash(pixel.y + pcg_hash(replica)))", "0u")
    done = harness("check-library", folder)
    assert done.status == 1
    first, *_, last = done.out.splitlines()
    assert first.startswith("mine/lib/random.glsl:20: pixel_stream: 65,535 of 65,536 pixels draw the very numbers of ")
    assert last.endswith(": 2 failed")
    report = harness("check-library", folder, "--json")
    assert report.status == 1 and not report.json["passed"]
    assert {found["function"] for found in report.json["findings"] if not found["passed"]} == {"pixel_stream"}


def test_several_functions_have_an_order(harness: Harness) -> None:
    done = harness("check-library", library("rng_state = pcg_hash(index ^ stream.x) + stream.y;", "rng_state = 5u;"))
    assert [line.split(": ")[1] for line in done.out.splitlines()[:2]] == ["seed_sample", "pixel_stream"]
    assert "\nmend them from the top: one further down may be wrong by one above it alone\n" in done.out


def test_no_folder(harness: Harness) -> None:
    assert refusal(harness("check-library", "nowhere")).startswith("'nowhere' is not a folder; give one that holds ")
