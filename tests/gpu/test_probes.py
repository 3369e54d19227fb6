"""The probes: rows keep their order, bad calls are refused, and no probe holds code of its own."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from harness.errors import ShaderError
from tests.support.tracer import evaluate

PROBES = sorted((Path(__file__).parents[2] / "glsl" / "probes").glob("*.frag"))


@pytest.mark.parametrize("rows", [1, 7, 1024, 1025, 5000])
def test_every_row_gets_its_own_answer(rows: int) -> None:
    """Whatever the number of rows, which need not fill a texture."""
    axes = np.random.default_rng(rows).normal(size=(rows, 4))
    axes[:, :3] /= np.linalg.norm(axes[:, :3], axis=1, keepdims=True)
    found = evaluate("basis.frag", axes, outputs=3)
    assert found.shape == (rows, 12) and found.dtype == np.float32
    np.testing.assert_allclose(found[:, 8:11], axes[:, :3], atol=1e-6)  # local z is the axis itself


def test_bad_calls_are_refused() -> None:
    """Inputs of unequal length or of other than four columns; a probe that does not exist."""
    with pytest.raises(ValueError, match=r"must be \(3, 4\)"):
        evaluate("pdf.frag", np.zeros((3, 4)), np.zeros((4, 4)))
    with pytest.raises(ValueError, match=r"must be \(3, 4\)"):
        evaluate("pdf.frag", np.zeros((3, 2)))
    with pytest.raises(ShaderError, match=r'no such shader file "probes/absent.frag"'):
        evaluate("absent.frag", np.zeros((3, 4)))


@pytest.mark.parametrize("path", PROBES, ids=lambda path: path.stem)
def test_probes_hold_no_code_of_their_own(path: Path) -> None:
    """Only `main` around library calls: what is tested is what renders. The first lines say what goes in and out."""
    text = path.read_text(encoding="utf-8")
    head = re.match(r"(//.*\n)+", text)
    assert head and " In: " in head[0].replace("\n// ", " ") and " Out: " in head[0].replace("\n// ", " ")
    assert re.findall(r"^\w+ (\w+)\(", text, re.MULTILINE) == ["main"]
    library = {f"lib/{file.name}" for file in (path.parents[1] / "lib").glob("*.glsl")}
    assert set(re.findall(r'#include "([^"]+)"', text)) <= {"scene.glsl", *library}
