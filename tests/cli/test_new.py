"""`harness new-shader` and `harness new-scene`: what they write and say, and that they overwrite nothing."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from harness.shader.starts import HOSTS
from tests.cli.conftest import Harness, refusal


@pytest.mark.parametrize("host", HOSTS)
def test_a_shader_is_written_where_it_was_asked_for(harness: Harness, host: str) -> None:
    """And the command that is printed names files that are there."""
    done = harness("new-shader", "work/mine", "--host", host)
    assert done.status == 0
    files = [Path(word) for word in shlex.split(done.out.splitlines()[1])[4:-2]]
    assert files and all(file.is_file() and file.parts[0] == "work" for file in files)
    assert sorted(files) == sorted(path for path in Path("work").rglob("*") if path.is_file())


def test_nothing_is_overwritten(harness: Harness) -> None:
    """Not one of several files: the other is not written either."""
    harness("new-shader", "mine", "--host", "shadertoy")
    Path("mine/bufferA.glsl").unlink()
    Path("mine/image.glsl").write_text("my own work")
    assert refusal(harness("new-shader", "mine", "--host", "shadertoy")) == (
        "mine/image.glsl: is there already and is left as it is; choose another name, or move it away")
    assert [path.name for path in Path("mine").iterdir()] == ["image.glsl"]
    assert Path("mine/image.glsl").read_text() == "my own work"


def test_a_scene_and_its_commands(harness: Harness) -> None:
    """They run; the gate's own tests are elsewhere."""
    done = harness("new-scene", "mine")
    assert done.status == 0
    render, study, gate = (shlex.split(line)[1:] for line in done.out.splitlines()[1:])
    assert harness(*render, "--size", "16x12", "--spp", 1).status == 0 and Path("mine.png").is_file()
    assert [study[:2], gate] == [["study", "mine.xml"], ["gate", "mine_gates.toml"]]


def test_scenes_share_their_images(harness: Harness) -> None:
    """But one of another content is not overwritten."""
    assert harness("new-scene", "one", "--from", "textures").status == 0
    assert "textures/" not in harness("new-scene", "two", "--from", "textures").out
    Path("textures/tiles.png").write_bytes(b"mine")
    assert refusal(harness("new-scene", "three", "--from", "textures")).startswith("textures/tiles.png: is there ")


def test_json(harness: Harness) -> None:
    shader = harness("new-shader", "mine", "--host", "gratin", "--json").json
    assert shader["files"] == ["mine.gra"] and shader["check"].startswith("harness check mine.gra --scene ")
    assert harness("new-scene", "mine.xml", "--json").json["files"] == ["mine.xml", "mine_gates.toml"]
