"""The proof of a cause: the author's own text with one line mended, judged again."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from harness.diagnosis import repaired as module
from harness.diagnosis.causes import Cause, Diagnosis
from harness.diagnosis.repaired import repaired
from harness.errors import ShaderError
from harness.estimators.shader import Shader
from harness.scene import SceneFile

WRONG = "vec3 weight(vec3 kd, vec3 n, vec3 l)\n{\n    return kd * max(dot(n, l), 0.0);  // ours\n}\n"
RIGHT = WRONG.replace(" * max(dot(n, l), 0.0)", "")
COSINE = Cause("defect", "cosine-twice", "the cosine twice", "weight", "", 0.9, same=True, behind=0.0)
TWICE = Diagnosis("cause", (COSINE,), 8.0, 60)
SCENE = SceneFile.bundled("diffuse")


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, str]]:
    """The texts that are judged: one passes where the cosine is gone, one with an include that is lost does not run."""
    judged: list[dict[str, str]] = []

    def judge(shader: Shader, scene: SceneFile, **options: Any) -> Any:
        files = [file for root in shader.files for file in (sorted(root.rglob("*")) if root.is_dir() else [root])]
        judged.append({file.name: file.read_text() for file in files if file.is_file()})
        if any("lost.glsl" in text and not (file.parent / "lost.glsl").is_file()
               for file in files if file.is_file() for text in [file.read_text()]):
            raise ShaderError("lost.glsl is not there")
        return SimpleNamespace(outcome="fail" if any("dot(n, l)" in text for text in judged[-1].values()) else "pass")

    monkeypatch.setattr(module, "judge_stranger", judge)
    return judged


def test_the_line_is_named_and_the_authors_file_stays(tmp_path: Path, seen: list[dict[str, str]]) -> None:
    file = tmp_path / "ada.frag"
    file.write_text(WRONG, encoding="utf-8")
    found = repaired(Shader((file,)), TWICE, SCENE)
    assert found is not None
    assert (found.where, found.before) == (f"{file}:3", "return kd * max(dot(n, l), 0.0);  // ours")
    assert found.after.startswith("return kd;")
    assert "with this line changed it passes" in found.sentence
    assert file.read_text(encoding="utf-8") == WRONG
    assert seen[-1]["ada.frag"].split("//")[0].split() == RIGHT.split("//")[0].split()


def test_files_of_a_folder_and_what_stands_beside_are_there_too(tmp_path: Path, seen: list[dict[str, str]]) -> None:
    """An include of the author's."""
    folder = tmp_path / "ada"
    folder.mkdir()
    (folder / "image.glsl").write_text('#include "lost.glsl"\n' + WRONG, encoding="utf-8")
    (folder / "lost.glsl").write_text("// here\n", encoding="utf-8")
    for files in ((folder,), (folder / "image.glsl",)):
        found = repaired(Shader(files), TWICE, SCENE)
        assert found is not None and found.where == f"{folder / 'image.glsl'}:4"


def test_a_line_within_an_export_of_shadertoy_is_mended(tmp_path: Path, seen: list[dict[str, str]]) -> None:
    """By its pass and its line there; all else of the export stays."""
    export = {"Shader": {"info": {"name": "ada"}, "renderpass": [
        {"name": "Image", "type": "image", "code": "void mainImage(out vec4 c, in vec2 p) { c = vec4(0.0); }"},
        {"name": "Buffer A", "type": "buffer", "code": f"// A\n{WRONG}", "inputs": [{"id": "1"}]}]}}
    file = tmp_path / "ada.json"
    file.write_text(json.dumps(export), encoding="utf-8")
    found = repaired(Shader((file,)), TWICE, SCENE)
    assert found is not None and found.where == f"{file} (Buffer A):4"
    mended = json.loads(seen[-1]["ada.json"])
    assert "return kd;" in mended["Shader"]["renderpass"][1].pop("code")
    export["Shader"]["renderpass"][1].pop("code")  # type: ignore[index, attr-defined]
    assert mended == export
    (tmp_path / "other.json").write_text("[1, 2]", encoding="utf-8")
    assert repaired(Shader((tmp_path / "other.json",)), TWICE, SCENE) is None


def test_none_where_nothing_passes_or_no_repair_is_known(tmp_path: Path, seen: list[dict[str, str]]) -> None:
    file = tmp_path / "ada.frag"
    file.write_text(WRONG + WRONG.replace("weight", "other").replace("kd *", "kd * dot(n, l) *"), encoding="utf-8")
    assert repaired(Shader((file,)), TWICE, SCENE) is None, "one line alone is not enough"
    assert 0 < len(seen) <= module.TRIED
    seen.clear()
    assert repaired(Shader((file,)), Diagnosis("unknown", (), 8.0, 60), SCENE) is None
    assert not seen
