"""Studies come back from disk as they were saved, and damage of any kind ends in one line."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.errors import StoreError
from harness.results import StudyResult
from harness.samples.estimate import Estimate
from harness.studies import storage
from harness.studies.storage import load_study, save_study
from tests.support.report import with_measured


def assert_same(found: Any, saved: Any, name: str = "result") -> None:
    """Equal field by field; images to float32."""
    if isinstance(saved, np.ndarray):
        assert found.shape == saved.shape, name
        np.testing.assert_array_equal(np.asarray(found, dtype=np.float32), np.asarray(saved, dtype=np.float32), name)
        if saved.ndim < 3 and "luminance_variance" not in name:
            np.testing.assert_array_equal(found, saved, name)
    elif dataclasses.is_dataclass(saved):
        assert type(found) is type(saved), name
        for field in dataclasses.fields(saved):
            assert_same(getattr(found, field.name), getattr(saved, field.name), f"{name}.{field.name}")
    elif isinstance(saved, dict):
        assert found.keys() == saved.keys(), name
        for key in saved:
            assert_same(found[key], saved[key], f"{name}.{key}")
    elif isinstance(saved, tuple):
        assert len(found) == len(saved), name
        for index, (one, other) in enumerate(zip(found, saved, strict=True)):
            assert_same(one, other, f"{name}[{index}]")
    else:
        assert found == saved or (found != found and saved != saved), name


@pytest.fixture
def saved(study: StudyResult, tmp_path: Path) -> Path:
    """A folder with a study in it."""
    save_study(study, tmp_path / "study")
    return tmp_path / "study"


def image(folder: Path, role: str) -> Path:
    """The file of one image of a saved study."""
    return folder / json.loads((folder / "study.json").read_text())["images"][role]


def test_a_study_comes_back_as_it_was_saved(study: StudyResult, saved: Path) -> None:
    assert_same(load_study(saved), study)


def test_an_exact_reference_and_a_missing_slope_come_back(exact: StudyResult, tmp_path: Path) -> None:
    save_study(exact, tmp_path)
    found = load_study(tmp_path)
    assert_same(found, exact)
    assert found.strategies[1].slope is None


def test_numbers_that_are_not_finite_come_back(study: StudyResult, tmp_path: Path) -> None:
    """An unknown variance gives NaN intervals and an infinite detectable bias, for which JSON has no numbers."""
    unknown = np.full(4, np.nan)
    first = study.strategies[0]
    verdict = dataclasses.replace(first.verdict, low=unknown, high=-unknown, smallest_detectable=np.full(4, np.inf))
    mixed = first.curves["rmse"].copy()
    mixed[0, 0] = np.nan
    strategy = with_measured(dataclasses.replace(first, verdict=verdict), scores={**first.scores, "flip": float("nan")},
                             curves={**first.curves, "rmse": mixed})
    changed = dataclasses.replace(study, strategies=(strategy,))
    save_study(changed, tmp_path)
    json.loads((tmp_path / "study.json").read_text(), parse_constant=lambda name: pytest.fail(f"{name} in JSON"))
    assert_same(load_study(tmp_path), changed)


def test_saving_again_replaces_the_old_study_and_nothing_else(study: StudyResult, saved: Path) -> None:
    (saved / "notes.exr").write_text("mine")
    fewer = dataclasses.replace(study, strategies=study.strategies[:1])
    save_study(fewer, saved)
    assert len(load_study(saved).strategies) == 1
    names = {path.name for path in saved.iterdir()}
    assert names == {"study.json", "notes.exr", image(saved, "reference").name, image(saved, "uniform").name}


def test_an_interrupted_save_leaves_the_old_study_whole(study: StudyResult, exact: StudyResult, saved: Path,
                                                        monkeypatch: pytest.MonkeyPatch) -> None:
    """Whichever image the interruption falls on: the old study still names its own images."""
    written = []

    def interrupted(path: Path, estimate: Estimate, metadata: dict[str, Any]) -> None:
        if len(written) == 2:
            raise KeyboardInterrupt
        written.append(path)
        path.write_bytes(b"half a study")

    monkeypatch.setattr(storage, "write_estimate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        save_study(exact, saved)
    assert len(written) == 2
    assert_same(load_study(saved), study)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("role", ["study.json", "reference", "mixture"])
def test_a_truncated_file_is_refused_in_one_line(saved: Path, role: str, share: float) -> None:
    path = saved / role if role.endswith(".json") else image(saved, role)
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)])
    with pytest.raises(StoreError) as caught:
        load_study(saved)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("change", [
    {"format": 99}, {"format": None}, {"strategies": []}, {"strategies": None}, {"exposure": "bright"},
    {"images": {}}, {"provenance": 3}, {"scene_hash": "0" * 16}])
def test_a_file_that_is_no_study_is_refused_in_one_line(saved: Path, change: dict[str, Any]) -> None:
    content = json.loads((saved / "study.json").read_text())
    (saved / "study.json").write_text(json.dumps({**content, **change}))
    with pytest.raises(StoreError) as caught:
        load_study(saved)
    assert str(saved) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(("name", "value"), [
    ("strategy", "another"), ("suits", "yes"), ("verdict", {}), ("tiles", {}),
    ("tiles", {"coarse": {"outcome": "maybe"}}), ("slope", {"slope": 1})])
def test_a_damaged_strategy_is_refused_in_one_line(saved: Path, name: str, value: object) -> None:
    content = json.loads((saved / "study.json").read_text())
    content["strategies"][0][name] = value
    (saved / "study.json").write_text(json.dumps(content))
    with pytest.raises(StoreError, match=r"study\.json: not a study .*; remove it"):
        load_study(saved)


@pytest.mark.parametrize("table", [
    None, {}, {"columns": {"value": [1.0]}}, {"columns": {}}, {"columns": 3}, {"same": {}}, {"same": 3}])
def test_a_damaged_table_is_refused_in_one_line(saved: Path, table: dict[str, Any] | None) -> None:
    content = json.loads((saved / "study.json").read_text())
    content["table"] = table and {**content["table"], **table}
    if table == {}:
        content["table"] = {}
    (saved / "study.json").write_text(json.dumps(content))
    with pytest.raises(StoreError, match=r"study\.json: not a study .*; remove it"):
        load_study(saved)


@pytest.mark.parametrize(("row", "column", "value"), [
    (0, "replica", 7), (0, "replica", "0"), (0, "samples", 1.5), (0, "quantity", "unknown"), (0, "value", "x"),
    (0, "value", None), (0, "parameters", 3), (0, "estimator", "another"), (-1, "quantity", "unknown"),
    (-2, "quantity", "rejected"), (-3, "device", 1)])
def test_a_damaged_row_is_refused_in_one_line(saved: Path, row: int, column: str, value: object) -> None:
    content = json.loads((saved / "study.json").read_text())
    table = content["table"]
    values = table["columns"].setdefault(column, [table["same"].pop(column, None)] * len(table["columns"]["value"]))
    values[row] = value
    (saved / "study.json").write_text(json.dumps(content))
    with pytest.raises(StoreError, match=r"study\.json: not a study .*; remove it"):
        load_study(saved)


@pytest.mark.parametrize(("name", "value"), [
    ("outcome", "maybe"), ("z", [1.0]), ("channel", "alpha"), ("detectable", [1.0]), ("p", None), ("x", "left")])
def test_a_damaged_finding_is_refused_in_one_line(saved: Path, name: str, value: object) -> None:
    content = json.loads((saved / "study.json").read_text())
    content["strategies"][0]["tiles"]["fine"][name] = value
    (saved / "study.json").write_text(json.dumps(content))
    with pytest.raises(StoreError, match=r"study\.json: not a study .*; remove it"):
        load_study(saved)


def test_a_study_without_tiles_is_of_an_earlier_format(saved: Path) -> None:
    content = json.loads((saved / "study.json").read_text())
    del content["strategies"][0]["tiles"]
    (saved / "study.json").write_text(json.dumps({**content, "format": 1}))
    with pytest.raises(StoreError, match=r"format 1 of a study, this version reads 6; remove it and run"):
        load_study(saved)


def test_images_of_another_study_or_strategy_are_refused(saved: Path) -> None:
    shutil.copy(image(saved, "uniform"), image(saved, "mixture"))
    with pytest.raises(StoreError, match="belongs to another study"):
        load_study(saved)


def test_image_names_cannot_lead_out_of_the_folder(saved: Path) -> None:
    content = json.loads((saved / "study.json").read_text())
    content["images"]["uniform"] = "../elsewhere.exr"
    (saved / "study.json").write_text(json.dumps(content))
    with pytest.raises(StoreError, match="not a study"):
        load_study(saved)


def test_a_missing_study_names_the_command_that_makes_one(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="no such study; run 'harness study' first"):
        load_study(tmp_path / "nowhere")
