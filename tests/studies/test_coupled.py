"""The comparison with the coupled oracle: small scenes, a wrong shader, and files that come back as they were."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from harness.errors import StoreError
from harness.estimators.tracer import Tracer
from harness.results import CoupledRecord
from harness.scene import SceneFile, load
from harness.shader.library import OURS
from harness.studies import coupled
from harness.studies.coupled import RECORDS_FILE, Drawn, load_coupled, measure_coupled, save_coupled, strategies_of

DRAWN = Drawn(replicas=8, spp=8, singles=2)
RECORD = CoupledRecord("a scene", "mixture", 8, 4, np.inf, (1e-7, -2e-6, 3e-6), 2048, 3, 1, 1.5,
                       np.random.default_rng(1).normal(size=(6, 8)).astype(np.float32))


def test_the_tracer_agrees_with_its_oracle() -> None:
    """Far closer than the noise of either, nearly every pixel, and nearly every single sample by itself.

    One path of 28,000 that parts leaves a ratio of some thousands; without any it is a million.
    """
    record = measure_coupled(SceneFile.bundled("diffuse", (24, 18)), "cosine", DRAWN)
    assert record.left.shape == (18, 24) and record.singles == 2 * 24 * 18
    assert record.ratio > 100 and (np.abs(record.left) < 1e-6).mean() > 0.98
    assert record.differing <= 5 and record.parting <= record.differing
    error, low, high = record.error
    assert low <= 0 <= high and abs(error) < 1e-4


def test_a_wrong_shader_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    """One part in ten thousand of each albedo: far below the noise of so few samples, and in every part of the map."""
    library = OURS.with_line("lib/phong.glsl", "return m.kd;", "return m.kd * 1.0001;")
    monkeypatch.setattr(coupled, "Tracer", lambda strategy: Tracer(strategy, library))
    record = measure_coupled(SceneFile.bundled("diffuse", (24, 18)), "cosine", DRAWN)
    assert 1e-5 < record.error[0] < 1e-3
    assert np.median(record.left) > 1e-5


def test_large_films_are_made_smaller_and_small_ones_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(coupled, "SIDE", 12)
    few = Drawn(replicas=2, spp=1, singles=1)
    assert measure_coupled(SceneFile.bundled("furnace_convex", (40, 20)), "uniform", few).left.shape == (6, 12)
    assert measure_coupled(SceneFile.bundled("furnace_convex", (8, 10)), "uniform", few).left.shape == (10, 8)


@pytest.mark.parametrize(("name", "expected"), [
    ("furnace_convex", ("mixture", "uniform")), ("cornell", ("mixture",)), ("displaced", ("mixture",))])
def test_a_second_strategy_is_compared_where_it_is_cheap(name: str, expected: tuple[str, ...]) -> None:
    assert strategies_of(load(SceneFile.bundled(name))) == expected


def test_records_come_back_as_they_were(tmp_path: Path) -> None:
    other = dataclasses.replace(RECORD, strategy="uniform", ratio=np.nan, left=RECORD.left[:3] / 2)
    save_coupled((RECORD, other), tmp_path)
    for held, kept in zip(load_coupled(tmp_path), (RECORD, other), strict=True):
        assert np.array_equal(held.left, kept.left)
        words = [{name: str(value) for name, value in vars(each).items() if name != "left"} for each in (held, kept)]
        assert words[0] == words[1]


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 no archive", None])
def test_damaged_records_are_refused_in_a_line(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / RECORDS_FILE
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(StoreError, match=r"coupled\.npz: missing or damaged .*; remove it and measure again$"):
        load_coupled(tmp_path)
