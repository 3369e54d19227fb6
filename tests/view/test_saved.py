"""A save is noticed however an editor does it, and work goes on through files that are broken for a while."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from harness.errors import HarnessError, MachineError, SceneError
from harness.view.saved import Interrupted, Saved, repeat


class Enough(Exception):
    """The end of a test of what has no end."""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.xml"
    path.write_text("old")
    return path


def wait(saved: Saved) -> None:
    """As `saved.wait()`, but a save that nobody notices fails the test in place of holding it up for ever."""
    assert saved._told.wait(60)
    saved.wait()


def replace(path: Path) -> None:
    """As most editors save: a new file takes the old one's name."""
    other = path.with_name(path.name + "~")
    other.write_text("new")
    os.replace(other, path)


@pytest.mark.parametrize("save", [lambda path: path.write_text("new"), replace, Path.unlink])
def test_a_save_is_noticed(scene: Path, save: Callable[[Path], object]) -> None:
    with Saved([scene]) as saved:
        assert not saved.any
        save(scene)
        wait(saved)
        assert saved.any and saved.names == ("scene.xml",)


def test_other_files_beside_it_do_not_count(scene: Path) -> None:
    """The image is often written there."""
    with Saved([scene]) as saved:
        scene.with_name("scene.exr").write_text("image")
        scene.with_name(".scene.xml.swp").write_text("editor's")
        scene.write_text("new")
        wait(saved)
        assert saved.names == ("scene.xml",)


def test_in_a_folder_of_shaders_new_ones_count_too(tmp_path: Path) -> None:
    with Saved([tmp_path]) as saved:
        (tmp_path / "4913").write_text("an editor tries whether it can write")
        (tmp_path / "phong.glsl").write_text("new")
        wait(saved)
        assert saved.names == ("phong.glsl",)


def test_a_link_is_followed(scene: Path, tmp_path: Path) -> None:
    (tmp_path / "links").mkdir()
    link = tmp_path / "links" / "scene.xml"
    link.symlink_to(scene)
    with Saved([link]) as saved:
        replace(scene)
        wait(saved)
        assert saved.any


def test_work_is_done_again_after_each_save_and_errors_are_told(scene: Path) -> None:
    told: list[str] = []
    seen: list[str] = []

    def work(check: Callable[[], None]) -> None:
        seen.append(scene.read_text())
        if len(seen) == 3:
            raise Enough
        scene.write_text("broken")  # while it is read: what was made of the old one is stale
        if len(seen) == 2:
            raise SceneError(f"{scene}:1: broken")

    with pytest.raises(Enough):
        repeat(lambda: [scene], work, told.append)
    assert seen == ["old", "broken", "broken"]
    assert f"harness: error: {scene}:1: broken" in told
    assert told.count("saved: scene.xml") == 2


def test_stale_work_is_left(scene: Path) -> None:
    left: list[bool] = []

    def work(check: Callable[[], None]) -> None:
        if left:
            raise Enough
        check()
        scene.write_text("new")
        try:
            while True:
                check()
        except Interrupted:
            left.append(True)
            raise

    with pytest.raises(Enough):
        repeat(lambda: [scene], work, lambda line: None)


def test_what_the_machine_lacks_ends_it(scene: Path) -> None:
    def work(check: Callable[[], None]) -> None:
        raise MachineError("no OpenGL")

    with pytest.raises(MachineError, match="no OpenGL"):
        repeat(lambda: [scene], work, lambda line: None)


def test_the_package_that_is_missing_is_named(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "watchfiles", None)
    with pytest.raises(HarnessError, match=r"--watch needs the package watchfiles; type: .* -m pip install"):
        Saved([scene])
