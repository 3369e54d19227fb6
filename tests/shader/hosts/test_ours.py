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
    show = ("#version 420\nuniform sampler2D pingpong0;\nin vec2 texcoord;\nout vec4 shown;\n"
            "void main() { shown = texture(pingpong0, texcoord); }\n")
    both = contract_of(tmp_path, display__frag=show, tracer__frag=text)
    assert [(one.name, one.displays) for one in both.passes] == [("tracer", False), ("display", True)]
    assert both.passes[1].channels[0].reads == "pass:tracer"
