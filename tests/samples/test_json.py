"""Records as JSON: what is saved comes back, and every damage ends in one line that says what to do."""

from __future__ import annotations

import json as plain_json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from harness.errors import StoreError
from harness.samples import json


@dataclass(frozen=True)
class Part:
    name: str
    size: float


@dataclass(frozen=True)
class Whole:
    kind: Literal["one", "many"]
    count: int
    right: bool
    parts: tuple[Part, ...]
    span: tuple[int, int]
    words: Mapping[str, str]
    low: float | None
    first: Part | None


WHOLE = Whole("many", 2, True, (Part("ä", 1.5), Part("b", -math.inf)), (3, 4), {"x": "y"}, None, Part("c", 1.0))


def load(path: Path) -> Whole:
    return json.load(path, lambda held: json.built(Whole, held), what="a whole", mend="make it again")


def test_what_is_saved_is_loaded(tmp_path: Path) -> None:
    path = tmp_path / "new" / "whole.json"
    json.save(path, WHOLE)
    assert load(path) == WHOLE
    held = plain_json.loads(path.read_text(encoding="utf-8"), parse_constant=lambda name: pytest.fail(name))
    assert held["parts"] == [{"name": "ä", "size": 1.5}, {"name": "b", "size": "-inf"}]


def test_arrays_come_back_as_float64_whatever_is_in_them() -> None:
    @dataclass
    class Held:
        values: np.ndarray

    values = np.array([[1.0, np.nan], [np.inf, -2.5]])
    found = json.converted(np.ndarray, json.plain(Held(values))["values"])
    np.testing.assert_array_equal(found, values)
    assert found.dtype == np.float64


def test_fields_that_stand_elsewhere_are_given() -> None:
    assert json.built(Part, {"name": "a", "more": 1}, size=2.0) == Part("a", 2.0)


@pytest.mark.parametrize("change", [
    {"kind": "few"}, {"count": 2.0}, {"count": True}, {"right": 1}, {"parts": {}}, {"parts": [3]}, {"span": [1]},
    {"parts": [{"name": "a"}]}, {"parts": [{"name": "a", "size": "large"}]}, {"parts": [{"name": "a", "size": True}]},
    {"words": []}, {"words": {"x": 1}}, {"low": "none"}, {"first": 3}, {"kind": None}])
def test_a_value_of_another_type_is_refused_by_its_name(tmp_path: Path, change: dict[str, Any]) -> None:
    path = tmp_path / "whole.json"
    json.save(path, json.plain(WHOLE) | change)
    with pytest.raises(StoreError) as caught:
        load(path)
    message, (name,) = str(caught.value), change
    assert message.startswith(f"{path}: not a whole (ValueError: {name}: ")
    assert message.endswith("); make it again") and "\n" not in message


def test_a_missing_field_is_named(tmp_path: Path) -> None:
    path = tmp_path / "whole.json"
    json.save(path, {"kind": "one"})
    with pytest.raises(StoreError, match="Whole without 'count'"):
        load(path)


@pytest.mark.parametrize("content", [b"", b"{", b"\xff", b"3", b"[]", b"null"])
def test_another_file_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "whole.json"
    path.write_bytes(content)
    with pytest.raises(StoreError, match=r"whole\.json: not a whole \(.*\); make it again") as caught:
        load(path)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_told_in_its_own_words_where_there_are_some(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match=r"x\.json: not it \(cannot be read: No such file or directory\); mend"):
        json.load(tmp_path / "x.json", str, what="it", mend="mend")
    with pytest.raises(StoreError, match=r"x\.json: run it first$"):
        json.load(tmp_path / "x.json", str, what="it", mend="mend", missing="run it first")


def test_an_interrupted_save_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "whole.json"
    json.save(path, WHOLE)
    with pytest.raises(TypeError):
        json.save(path, {"a": object()})
    assert load(path) == WHOLE
    assert [each.name for each in tmp_path.iterdir()] == ["whole.json"]
