"""Parts of a report that are made several at a time."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

import pytest

from harness.errors import SceneError
from harness.gpu.width import _Process
from harness.samples import spent
from harness.studies.ahead import Part, make_ahead


def write(path: Path, text: str) -> None:
    with spent.spent("writing"):
        path.write_text(text, encoding="utf-8")


def note(path: Path) -> None:
    path.write_text(f"{os.getpid()} {_Process.asked}", encoding="utf-8")


def refuse() -> None:
    raise SceneError("odd.xml:7: no such shape")


def test_every_part_is_made_and_its_time_told_the_longest_first(tmp_path: Path) -> None:
    parts = [Part(name, work, partial(write, tmp_path / name, name)) for name, work in (("short", 1.0), ("long", 9.0))]
    spending = spent.watch()
    try:
        elapsed = make_ahead(parts, jobs=2)
    finally:
        spent.unwatch()
    assert list(elapsed) == ["long", "short"]
    assert all(seconds > 0 for seconds in elapsed.values())
    assert {path.read_text(encoding="utf-8") for path in tmp_path.iterdir()} == {"long", "short"}
    assert "writing" in dict(spending.table())


def test_fragments_are_drawn_by_a_process_of_the_usual_width(tmp_path: Path) -> None:
    """Before and after parts that are not."""
    make_ahead([Part(name, work, partial(note, tmp_path / name), fragments=name == "fragments")
                for name, work in (("first", 3.0), ("fragments", 2.0), ("last", 1.0))], jobs=1)
    told = {path.name: path.read_text(encoding="utf-8").split() for path in tmp_path.iterdir()}
    assert {name: asked for name, (_, asked) in told.items()} == {"first": "True", "fragments": "False", "last": "True"}
    assert told["first"][0] == told["last"][0] != told["fragments"][0]


def test_what_a_part_raises_is_raised_here() -> None:
    with pytest.raises(SceneError, match=r"odd\.xml:7: no such shape"):
        make_ahead([Part("odd", 1.0, refuse)], jobs=2)


def test_nothing_to_make_starts_no_process() -> None:
    assert make_ahead([], jobs=2) == {}
