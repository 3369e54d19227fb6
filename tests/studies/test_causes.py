"""How often causes are named: strangers in disguise, what counts as named, and right ones that are accused."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.diagnosis import stranger
from harness.diagnosis.causes import candidates, load_defects
from harness.errors import HarnessError, StoreError
from harness.mutants.variants import load_variants
from harness.samples.store import Store
from harness.scene import SceneFile
from harness.shader.library import OURS, Library
from harness.studies import causes
from harness.studies.causes import CausesFile, causes_file, load_causes, measure_causes, save_causes

CHOSEN = ("cosine-twice", "albedo-squared", "lens-twice")  # the scene has no lens
RIGHT = {"ours": OURS, **{each.id: each.applied() for each in load_variants() if each.id == "other-hash"}}


@pytest.fixture
def little(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few defects, small images, one strategy of the right ones."""
    chosen = [each for each in load_defects() if each.id in CHOSEN]
    for module in (causes, candidates):
        monkeypatch.setattr(module, "load_defects", lambda: chosen)
    monkeypatch.setattr(causes, "SIDE", 12)
    monkeypatch.setattr(causes, "ALL", ("cosine",))
    monkeypatch.setattr(stranger, "REFERENCE_SPP", 16)


def test_causes_are_named_and_one_that_is_wrong_is_accused(little: None, tmp_path: Path) -> None:
    """The second of the right ones is none: twice as bright."""
    bright = OURS.with_line("lib/path.glsl", "radiance = vec3(0.0);", "radiance = vec3(0.1);")
    right: dict[str, Library] = {**RIGHT, "bright": bright}
    kept: list[CausesFile] = []
    store = Store(tmp_path / "store")
    found = measure_causes([SceneFile.bundled("diffuse")], right, store=store, keep=kept.append)
    record, = found.records
    assert kept == [found] and record.size == (16, 12) and record.spp == 256
    assert (record.presented, record.visible, record.first, record.three) == (2, 2, 2, 2)
    assert record.right == 3 and [each.shader for each in record.accused] == ["bright"]
    save_causes(found, tmp_path / "causes.json")
    assert load_causes(tmp_path / "causes.json") == found


def test_a_stranger_has_another_generator_and_another_strategy_where_its_picture_has_not() -> None:
    by_id = {each.id: each for each in load_defects()}
    free, own = (causes._disguised(by_id[name], by_id[name].pictures[0], 2, RIGHT) for name in (
        "cosine-twice", "specular-cosine-missing"))
    assert (free.strategy, free.disguise, own.strategy, own.disguise) == ("lobes", "other-hash", "lobes", "other-hash")
    changed = {line.line for line in free.library.lines}
    assert {line.line for line in RIGHT["other-hash"].lines} < changed
    stuck = by_id["state-not-advanced"]
    assert causes._disguised(stuck, stuck.pictures[0], 0, RIGHT).disguise == "", "both are in one line"


def test_no_scene_and_a_damaged_file_are_told(tmp_path: Path) -> None:
    with pytest.raises(HarnessError, match="there is no scene to present strangers on"):
        measure_causes([], RIGHT)
    (tmp_path / "causes.json").write_text("{}")
    with pytest.raises(StoreError, match=r"causes\.json: not a measurement .*; run `harness causes` again"):
        load_causes(tmp_path / "causes.json")


def test_the_one_that_comes_with_the_harness_names_most_and_accuses_none() -> None:
    found = load_causes(causes_file())
    visible, first, three = (sum(getattr(each, name) for each in found.records)
                             for name in ("visible", "first", "three"))
    assert first >= 0.9 * visible and three >= 0.98 * visible
    assert all(each.right >= 40 and not each.accused for each in found.records)
