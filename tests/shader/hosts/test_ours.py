"""The course's own contract, read as a stranger's."""

from __future__ import annotations

from pathlib import Path

from harness.shader.library import OURS
from tests.support.scenes import SceneWriter
from tests.support.strangers import contract_of


def test_our_tracer_is_read_with_its_samples_numbered(tmp_path: Path, scene: SceneWriter) -> None:
    text = OURS.tracer(scene('<shape type="sphere"><bsdf type="diffuse"/></shape>'), "lobes").text
    contract = contract_of(tmp_path, tracer__frag=text)
    assert contract.host == "native" and contract.samples == 16 and not contract.unknown
    assert contract.passes[0].roles == (("numpass", "frame"),)
    assert contract_of(tmp_path, values={"samples_per_pass": 4}, tracer__frag=text).samples == 4
