"""From the picture to the line: our own export with one line broken fails, its cause is named, the repair is proven."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.diagnosis import stranger
from harness.diagnosis.causes import candidates, load_defects
from harness.diagnosis.checked import check_shader
from harness.estimators.shader import Shader
from harness.samples.store import Store
from harness.scene import SceneFile, load
from harness.shader.exports import export

SCENE = SceneFile.bundled("diffuse", (16, 12))
# Those whose pictures are the nearest, and some that are far.
CHOSEN = ("cosine-twice", "cosine-squared-drawn", "half-weight", "albedo-squared", "one-bounce-less", "cosine-missing")
LINE = "return m.kd;"


def test_from_cause_to_proof(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stranger, "_frames_of_a_batch", lambda *arguments: 16)  # by their number, not by seconds
    monkeypatch.setattr(candidates, "load_defects", lambda: [each for each in load_defects() if each.id in CHOSEN])
    text = export(load(SCENE), "cosine", "glsl")["diffuse.frag"]
    assert isinstance(text, str) and text.count(LINE) == 1
    file = tmp_path / "homework.frag"
    wrong = text.replace(LINE, "return m.kd * max(dot(n, l), 0.0);")
    file.write_text(wrong, encoding="utf-8")
    line = text[:text.index(LINE)].count("\n") + 1

    found = check_shader(Shader((file,)), SCENE, store=Store(tmp_path / "store"), tolerance=0.02, spp=2048)

    assert found.judged is not None and found.judged.outcome == "fail"
    assert found.diagnosis is not None and found.diagnosis.outcome == "cause", found.diagnosis
    assert found.diagnosis.causes[0].id == "cosine-twice"
    assert found.repaired is not None
    assert found.repaired.where == f"{file}:{line}"
    assert "with this line changed it passes: `return m.kd;`" in found.repaired.sentence
    assert found.repaired.judged.outcome == "pass"
    assert file.read_text(encoding="utf-8") == wrong, "the author's file stays as it is"
