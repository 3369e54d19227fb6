"""`harness autopsy`: what it prints, its exit status, and bad input in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from harness.cli import main
from harness.files import data_dir

SPHERES = str(data_dir("mitsuba_scenes") / "spheres.xml")
SMALL = ("--size", "24x18", "--samples", "1")


@pytest.fixture
def wrong(tmp_path: Path) -> Path:
    """A folder whose diffuse term is half a percent too large."""
    folder = tmp_path / "mine"
    (folder / "lib").mkdir(parents=True)
    text = (data_dir("glsl") / "lib" / "phong.glsl").read_text(encoding="utf-8")
    assert text.count("f += m.kd * INV_PI;") == 1
    (folder / "lib" / "phong.glsl").write_text(text.replace("f += m.kd * INV_PI;", "f += m.kd * 0.32;"),
                                               encoding="utf-8")
    return folder


def test_a_right_shader_ends_well(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["autopsy", SPHERES, *SMALL]) == 0
    out = capsys.readouterr().out
    assert "no stage differs" in out and "radiance" in out


def test_a_wrong_one_is_told_by_its_own_file_and_line(wrong: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["autopsy", SPHERES, "--library", str(wrong), *SMALL]) == 1
    out = capsys.readouterr().out
    assert "FIRST DIFFERENCE: brdf" in out
    assert f"computed by eval_phong, {wrong / 'lib' / 'phong.glsl'}:" in out
    assert "one such path, side by side:" in out and "! brdf" in out


def test_as_json_it_has_all_that_the_text_says(wrong: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["autopsy", SPHERES, "--library", str(wrong), "--json", *SMALL]) == 1
    found = json.loads(capsys.readouterr().out)["autopsy"]
    assert found["stage"] == "brdf" and found["places"][0]["function"] == "eval_phong"
    assert found["where"]["share"] > 0.5 and found["path"] and found["size"] == [24, 18]
    assert {"stage", "asked", "differs", "first", "tolerance"} <= set(found["stages"][0])


@pytest.mark.parametrize(("arguments", "message"), [
    (("absent.xml",), "absent.xml"),
    ((SPHERES, "--library", "absent"), "--library: 'absent' is not a folder"),
    ((SPHERES, "--strategy", "best"), "unknown strategy 'best'"),
    ((SPHERES, "--size", "0x0"), "--size: expected WIDTHxHEIGHT"),
])
def test_bad_input_is_one_line(arguments: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["autopsy", *arguments]) == 2
    err = capsys.readouterr().err
    assert message in err and err.count("\n") == 1
