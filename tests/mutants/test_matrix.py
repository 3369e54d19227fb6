"""The kill matrix as a file: read back as it was written, and nothing else is taken for one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from harness.errors import StoreError
from harness.mutants.catalogue import Mutant
from harness.mutants.matrix import KillMatrix, load, record, save

BUG = Mutant("a", "lib/phong.glsl", "x;", "y;", "a slip", "issue 3", "sky", "phong.toml:1")
MATRIX = KillMatrix((BUG,), ("sky", "probe"), (("killed", "not run"),))


def test_what_is_saved_is_loaded(tmp_path: Path) -> None:
    save(MATRIX, tmp_path / "mutants.json")
    found = load(tmp_path / "mutants.json")
    assert found == record(MATRIX)
    assert found.mutants[0].topic == "phong" and found.mutants[0].states == {"sky": "killed", "probe": "not run"}


@pytest.mark.parametrize("broken", ["", "3", "{}", '{"gates": []}'])
def test_another_file_is_refused(tmp_path: Path, broken: str) -> None:
    (tmp_path / "mutants.json").write_text(broken, encoding="utf-8")
    with pytest.raises(StoreError, match=r"mutants\.json: not a kill matrix \(.*\); run `harness mutants` again"):
        load(tmp_path / "mutants.json")


def test_a_mutant_without_a_state_is_refused(tmp_path: Path) -> None:
    save(MATRIX, tmp_path / "mutants.json")
    held = json.loads((tmp_path / "mutants.json").read_text(encoding="utf-8"))
    del held["mutants"][0]["states"]["probe"]
    (tmp_path / "mutants.json").write_text(json.dumps(held), encoding="utf-8")
    with pytest.raises(StoreError, match="KeyError: 'probe'"):
        load(tmp_path / "mutants.json")
