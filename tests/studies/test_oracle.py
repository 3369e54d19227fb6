"""The oracle against `path`: it goes on where it was, divides its time by the noise, and sees what both share."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError, StoreError
from harness.reference.draws import Draw
from harness.samples.store import Store
from harness.scene import SceneFile
from harness.studies import oracle
from harness.studies.oracle import OracleFile, compared, load_oracle, measure_oracle, oracle_file, save_oracle
from harness.work.run import Run
from tests.support.fakes import NoiseRenderer


@pytest.fixture
def little(monkeypatch: pytest.MonkeyPatch) -> None:
    """Images and batches of next to nothing."""
    monkeypatch.setattr(oracle, "SIDE", 12)
    monkeypatch.setattr(oracle, "SPP", 4)
    monkeypatch.setattr(oracle, "FIRST", 4)


def drawn(renderer: NoiseRenderer, replicas: int) -> Run:
    run = Run(renderer, 4)
    run.grow(replicas)
    return run


def test_it_agrees_and_is_kept_after_each_scene(little: None, tmp_path: Path) -> None:
    """A second run with the same seconds reads all and draws nothing; one with more adds to it."""
    kept: list[OracleFile] = []
    scenes = [SceneFile.bundled(name) for name in ("furnace_convex", "diffuse")]
    store = Store(tmp_path / "store")
    found = measure_oracle(scenes, "mixture", 0.05, store, keep=kept.append)
    assert [len(each.records) for each in kept] == [1, 2] and kept[-1] == found
    assert [record.scene for record in found.records] == ["furnace_convex", "diffuse"]
    for record in found.records:
        assert record.agrees and max(record.size) == 12 and min(record.spp) >= 16
        assert record.error[1] < record.error[0] < record.error[2]
    assert measure_oracle(scenes, "mixture", 0.05, store).records == found.records
    save_oracle(found, tmp_path / "oracle.json")
    assert load_oracle(tmp_path / "oracle.json") == found


def test_there_are_no_more_replicas_than_seeds(little: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """However long it may take: an hour ended at replica 1024 of a furnace."""
    monkeypatch.setattr(oracle, "MOST", 6)
    for seconds, spp in ((256.0, 4), (257.0, 8), (1025.0, 32)):
        found = measure_oracle([SceneFile.bundled("furnace_convex")], "mixture", seconds).records[0]
        assert found.spp == (6 * spp, 6 * spp)


def test_what_both_sides_of_a_coupled_verdict_share_shows_here(little: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """All directions along the normal: a weight knows nothing of it, and a shader that did so too would agree."""
    right = Draw.direction
    monkeypatch.setattr(Draw, "direction", lambda self, normal, *rest: (normal, *right(self, normal, *rest)[1:]))
    assert not measure_oracle([SceneFile.bundled("diffuse")], "mixture", 0.3).records[0].agrees


def test_rounding_where_there_is_no_noise_is_no_difference() -> None:
    """One part in a million of a sky that is the same in every sample; a hundred times as much is one."""
    for bias, agrees in ((1e-6, True), (1e-4, False)):
        sides = [drawn(NoiseRenderer(mean, 0.0), 8) for mean in (0.5 * (1 + bias), 0.5)]
        record = compared("sky", "mixture", sides[0], sides[1], 1)
        assert record.agrees == agrees
        assert (record.fine.deviate == 0) == agrees


def test_a_bias_beyond_the_noise_is_found_and_what_is_sure_to_show_is_larger() -> None:
    sides = [drawn(NoiseRenderer(mean, 0.05), 32) for mean in (0.51, 0.5)]
    record = compared("noise", "mixture", sides[0], sides[1], 1)
    assert not record.agrees and record.mean.deviate > record.mean.critical
    assert record.error[0] == pytest.approx(0.02, abs=0.002) and record.mean.detectable < 0.02 < record.fine.detectable
    assert record.spp == (128, 128) and record.seconds == pytest.approx(256e-3)


def test_no_scene_and_a_damaged_file_are_told(tmp_path: Path) -> None:
    with pytest.raises(HarnessError, match="there is no scene to hold the oracle against"):
        measure_oracle([], "mixture", 1.0)
    (tmp_path / "oracle.json").write_text("{}")
    with pytest.raises(StoreError, match=r"oracle\.json: not a comparison .*; run `harness oracle` again"):
        load_oracle(tmp_path / "oracle.json")


def test_the_one_that_comes_with_the_harness_is_of_every_scene_and_agrees() -> None:
    found = load_oracle(oracle_file())
    names = {path.stem for path in SceneFile.bundled("spheres").path.parent.glob("*.xml")}
    assert {record.scene for record in found.records} == names
    assert all(record.agrees for record in found.records)
    assert all(np.isfinite(record.error).all() for record in found.records)
    assert dataclasses.replace(found, records=()).date == found.date > "2026"
