"""Gratin bodies without their head."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.support.strangers import contract_of, drawn, refused

SUM = """in vec2 texcoord;
void main() {
    vec4 past = numpass == 0 ? vec4(0.0) : texture(pingpong0, texcoord);
    outBuffer0 = past + vec4(texcoord, float(numpass), 1.0);
}
"""
SHOW = "in vec2 texcoord;\nvoid main() { vec4 s = texture(inBuffer0, texcoord); outBuffer0 = s / s.a; }\n"


def test_a_body_gets_gratins_head(tmp_path: Path) -> None:
    contract = contract_of(tmp_path, tracer__frag=SUM)
    assert contract.host == "body" and contract.radiance == "tracer" and not contract.unknown
    one = contract.passes[0]
    assert [(channel.name, channel.reads) for channel in one.channels] == [("pingpong0", "self")]
    assert one.roles == (("numpass", "frame"),) and not one.displays
    image = drawn(contract, numpass=3)
    x, y = np.meshgrid((np.arange(8) + 0.5) / 8, (np.arange(6) + 0.5) / 6)
    np.testing.assert_allclose(image, np.stack([x, y, np.full_like(x, 3.0), np.full_like(x, 2.0)], axis=-1), rtol=1e-6)


def test_of_two_bodies_one_shows_the_other(tmp_path: Path) -> None:
    contract = contract_of(tmp_path, show__frag=SHOW, tracer__frag=SUM)
    assert [(one.name, one.displays) for one in contract.passes] == [("tracer", False), ("show", True)]
    assert contract.passes[1].channels[0].reads == "pass:tracer" and contract.radiance == "tracer"


def test_a_parameter_that_somebody_gives_a_value_is_declared(tmp_path: Path) -> None:
    text = SUM.replace("1.0)", "exposure)").replace("float(numpass)", "sun.z")
    contract = contract_of(tmp_path, values={"exposure": 2.5, "sun": (1.0, 2.0, 3.0)}, tracer__frag=text)
    assert contract.values == (("exposure", 2.5), ("sun", (1.0, 2.0, 3.0)))
    assert contract.said == ("exposure=2.5", "sun=1,2,3")
    assert drawn(contract)[0, 0].tolist()[2:] == [3.0, 2.5]


def test_an_input_that_nobody_feeds_is_asked_for(tmp_path: Path) -> None:
    text = SUM.replace("numpass)", "numpass) + texture(inBuffer0, texcoord).r")
    assert [one.name for one in contract_of(tmp_path, tracer__frag=text).unknown] == ["inBuffer0"]
    known = contract_of(tmp_path, values={"inBuffer0": "file:sky.png"}, tracer__frag=text)
    assert not known.unknown and known.passes[0].channels[0].reads == "file:sky.png"


def test_two_bodies_that_sum_and_a_parameter_without_a_type_are_refused(tmp_path: Path) -> None:
    refused(tmp_path, "b.frag:1: a second body that reads pingpong0", "a.frag", a__frag=SUM, b__frag=SUM)
    refused(tmp_path, "c.frag:4: ", "`exposure' undeclared", c__frag=SUM.replace("1.0)", "exposure)"))
