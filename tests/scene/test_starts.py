"""Starts for scenes: what is written is read by both sides, is the bundled scene, and its gates file holds."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from harness.errors import HarnessError
from harness.files import create_files, data_dir
from harness.gates import load_gates
from harness.scene import load, load_scene
from harness.scene.starts import gates_file, start


@pytest.mark.parametrize("source", ["starts/ball", "textures", "traps/seam"])
def test_a_start_is_the_bundled_scene_with_its_images(source: str, tmp_path: Path) -> None:
    """By the hash of what it says: images are taken along, wherever the scene finds them."""
    path = tmp_path / "mine.xml"
    create_files(start(path, source))
    original = data_dir("mitsuba_scenes") / f"{source}.xml"
    assert load_scene(path).content_hash == load_scene(original).content_hash
    assert path.read_text(encoding="utf-8").splitlines()[0] == original.read_text(encoding="utf-8").splitlines()[0]


def test_its_gate_is_about_it(tmp_path: Path) -> None:
    path = tmp_path / "mine.xml"
    create_files(start(path))
    gate, = load_gates(gates_file(path)).gates
    assert gate.name == "mine" and gate.scene.path == path


def test_its_parameters_are_heeded(tmp_path: Path) -> None:
    """As the comment beside them says."""
    from harness.scene import SceneFile

    path = tmp_path / "mine.xml"
    create_files(start(path))
    scene = load(SceneFile(path, (("alpha", "100"), ("width", "40"))))
    assert (scene.width, scene.height) == (40, 96)
    assert {shape.material.alpha for shape in scene.shapes} == {1.0, 100.0}


@pytest.mark.parametrize(("path", "source", "says"), [
    ("mine.txt", "spheres", "a scene is an .xml file"), ("mi ne.xml", "spheres", "whose name has letters, digits"),
    ("mine.xml", "cornel", "unknown scene 'cornel'")])
def test_refusals(path: str, source: str, says: str) -> None:
    with pytest.raises(HarnessError, match=re.escape(says)):
        start(Path(path), source)
