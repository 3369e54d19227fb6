"""Grades as files: a teacher sees all, a student what the hints allow."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import pytest

from harness.errors import HarnessError
from harness.grading.records import HINTS, Graded, Hints, Part, told
from harness.grading.sheets import CSV_FILE, GRADESCOPE_FILE, INDEX_FILE, gradescope, sheets
from harness.grading.submissions import submissions
from harness.shader.hosts import read

PNG = bytes.fromhex("89504e470d0a1a0a")
ADA = Graded(
    "ada", ("ada.frag",), "fail", "luminance is 12 % too dark", error=(-0.13, -0.12, -0.11),
    parts=(Part("runs", 0.1, 1.0, "it does"), Part("radiance", 0.9, 0.5, "12 % too dark")),
    place="worst on the floor", family="a weight of the sampled direction", formula="the cosine stands there twice",
    findings=(("none", "repeats its numbers"), ("formula", "line 12 reads `seed = 1`")),
    pictures=(("image", PNG), ("difference", PNG + b"d")), seconds=3.25)
BOB = Graded("bob", ("bob/a.frag", "bob/b.frag"), "pass", "right within 0.2 %", parts=(Part("runs", 1.0, 1.0, "yes"),))
SECRETS = {"place": "worst on the floor", "family": "a weight of the sampled", "formula": "cosine stands there twice"}


def test_the_table_tells_what_is_wrong_before_where() -> None:
    plain = replace(ADA, family="", formula="")
    text = sheets([plain], scene="spheres", hints="none", points=20)[INDEX_FILE].decode()
    assert "luminance is 12 % too dark; worst on the floor" in text


class TestHints:
    """Nothing leaks beyond what was asked for."""

    @pytest.mark.parametrize("hints", HINTS)
    def test_each_level_tells_its_own_and_those_before(self, hints: Hints) -> None:
        files = sheets([ADA, BOB], scene="spheres", hints=hints, points=20)
        page, results = files["ada/index.html"].decode(), files["ada/results.json"].decode()
        for level, secret in SECRETS.items():
            allowed = HINTS.index(hints) >= HINTS.index(level)
            assert (secret in page) == (secret in results) == allowed
        assert ("line 12" in page) == ("line 12" in results) == (hints == "formula")
        assert "repeats its numbers" in page
        assert ("<img" in page) == (hints != "none"), "a picture of the difference is a place"

    def test_a_teacher_sees_all(self) -> None:
        files = sheets([ADA], scene="spheres", hints="none", points=20)
        assert "cosine stands there twice" in files[INDEX_FILE].decode()
        assert "cosine stands there twice" in files[CSV_FILE].decode()

    def test_with_all_hints_nothing_is_lost(self) -> None:
        assert told(ADA, "formula") == ADA


class TestFiles:
    """What programs read."""

    def test_csv_has_a_row_each(self) -> None:
        table = sheets([ADA, BOB], scene="spheres", hints="none", points=20)[CSV_FILE].decode()
        rows = list(csv.DictReader(io.StringIO(table)))
        assert [(row["name"], row["outcome"], row["points"]) for row in rows] == [("ada", "fail", "11.0"),
                                                                                ("bob", "pass", "20.0")]
        assert float(rows[0]["error"]) == -0.12
        assert rows[1]["error"] == ""

    @pytest.mark.parametrize("name", ["=1+1", "+x", "-x", "@x"])
    def test_no_name_becomes_a_formula(self, name: str) -> None:
        """A spreadsheet would compute it."""
        table = sheets([replace(BOB, name=name)], scene="spheres", hints="none", points=20)[CSV_FILE].decode()
        assert next(csv.DictReader(io.StringIO(table)))["name"] == f"'{name}"

    def test_names_and_messages_are_text_in_html(self) -> None:
        evil = replace(BOB, name="<script>alert(1)</script>", sentence="<b>bold</b>")
        for name, content in sheets([evil], scene="spheres", hints="none", points=1).items():
            assert name.endswith((".csv", ".json")) or (b"<script>alert" not in content and b"<b>bold" not in content)

    def test_gradescope_adds_up(self) -> None:
        """The format: score, and tests with score, max_score and a status."""
        found = gradescope(ADA, 20)
        assert found["score"] == 11.0 == sum(test["score"] for test in found["tests"])
        assert sum(test["max_score"] for test in found["tests"]) == 20
        assert [test["status"] for test in found["tests"]] == ["passed", "failed"]
        written = sheets([ADA], scene="spheres", hints="formula", points=20)[f"ada/{GRADESCOPE_FILE}"]
        assert json.loads(written) == found


class TestSubmissions:
    """A file or a folder a student."""

    def test_are_files_and_folders(self, tmp_path: Path) -> None:
        for name in ("eva.gra", "ada/image.glsl", "ada/bufferA.glsl", "ada/notes.txt", "ada/.git/x.frag", "README.md",
                     ".hidden/x.frag", "empty/none.txt", "kim/src/a.frag"):
            (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
            (tmp_path / name).write_text("void main() {}", encoding="utf-8")
        found = submissions(tmp_path)
        assert [(each.name, *each.names) for each in found] == [
            ("ada", "bufferA.glsl", "image.glsl"), ("eva", "eva.gra"), ("kim", "a.frag")]
        assert found[0].files == (tmp_path / "ada",)

    def test_a_folder_with_an_export_beside_its_tabs_is_one_shader(self, tmp_path: Path) -> None:
        """As `harness export --host shadertoy` writes it, and as `harness check` reads it."""
        code = "void mainImage(out vec4 c, in vec2 p) { c = texelFetch(iChannel0, ivec2(p), 0) + vec4(1.0); }"
        (tmp_path / "ada").mkdir()
        for name in ("bufferA.glsl", "image.glsl"):
            (tmp_path / "ada" / name).write_text(code, encoding="utf-8")
        (tmp_path / "ada" / "ball.json").write_text(json.dumps({"Shader": {"renderpass": [
            {"name": "Image", "type": "image", "code": code}]}}), encoding="utf-8")
        (one,) = submissions(tmp_path)
        assert read(one.files).host == "shadertoy"

    def test_two_of_one_name_are_refused(self, tmp_path: Path) -> None:
        (tmp_path / "ada.frag").touch()
        (tmp_path / "ada.glsl").touch()
        with pytest.raises(HarnessError, match=r"ada\.glsl: a second submission called 'ada' beside .*ada\.frag"):
            submissions(tmp_path)

    @pytest.mark.parametrize("make", [True, False])
    def test_without_any_there_is_one_line(self, tmp_path: Path, make: bool) -> None:
        folder = tmp_path / "x"
        if make:
            folder.mkdir()
        with pytest.raises(HarnessError, match="holds no shader" if make else "no such folder"):
            submissions(folder)
