"""Gratin pipelines."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest

from harness.errors import HarnessError
from harness.shader.hosts import read
from tests.shader.hosts.test_body import SHOW, SUM
from tests.support.strangers import compiled, contract_of, drawn, refused


def node(index: int, name: str, body: str, kind: str = "pingPongGenericId", inputs: int = 0, extra: str = "",
         widget: str = "") -> str:
    names = "".join(f'<string name="nodeInputName-{index}-{n}" val="inBuffer{n}"/>' for n in range(inputs))
    return f"""<string name="nodeStringId-{index}" val="{kind}"/><string name="nodeName-{index}" val="{name}"/>
<int name="nodeInputNameSize-{index}" val="{inputs}"/>{names}
<IOData name="node-{index}">
<string name="genericFragBody" val={quoteattr(body, {chr(10): "&#xa;"})}/>
<vector2f name="genericTOffset"><float name="0" val="48"/><float name="1" val="32"/></vector2f>
<int name="genericOutFilter" val="9729"/><int name="pingPongNumber" val="8"/>{extra}
</IOData>
<IOData name="nodeWidget-{index}">{widget}</IOData>"""


def pipeline(*nodes: str, connections: str = "") -> str:
    return (f'<Gratin type="pipeline"><IOData name="mainWindow"><IOData name="graphWidget"><IOData name="graph">'
            f'<uint name="nbNodes" val="{len(nodes)}"/>{"".join(nodes)}{connections}</IOData></IOData></IOData>'
            '</Gratin>')


def connection(source: int, target: int, number: int = 0) -> str:
    return (f'<uint name="nbConnections-{source}-{target}" val="1"/><vector2u name="connection-{source}-{target}-0">'
            f'<uint name="0" val="0"/><uint name="1" val="{number}"/></vector2u>')


def parameter(index: int, kind: int, name: str) -> str:
    return (f'<int name="genericWidgetType-{index}" val="{kind}"/><string name="genericWidgetName-{index}" '
            f'val="{name}"/>')


def widget(index: int, attribute: str, value: str) -> str:
    return (f'<IOData name="childWidget-{index}"><IOData name="{attribute}AttribCurve">{value}<uint name="nbCurves" '
            'val="1"/></IOData></IOData>')


def test_two_nodes_become_two_passes(tmp_path: Path) -> None:
    # The node that shows stands first in the file: the order is that of the connections.
    text = pipeline(node(0, "display", SHOW, "imgGenericId", 1), node(1, "tracer", SUM), connections=connection(1, 0))
    contract = contract_of(tmp_path, two__gra=text)
    assert contract.host == "gratin" and contract.radiance == "tracer"
    assert [(one.name, one.displays) for one in contract.passes] == [("tracer", False), ("display", True)]
    assert [(c.name, c.reads, c.linear) for one in contract.passes for c in one.channels] == [
        ("pingpong0", "self", True), ("inBuffer0", "pass:tracer", True)]
    assert any("Gratin draws it at 48 x 32, 8 passes at a time" in note for note in contract.notes)
    assert drawn(contract, numpass=0)[0, 0].tolist() == pytest.approx([0.0625, 1 / 12, 0.0, 1.0])


def test_parameters_have_the_values_of_their_widgets(tmp_path: Path) -> None:
    body = SUM.replace("float(numpass), 1.0", "exposure * sun.y + float(bounces), 1.0")
    extra = f'<uint name="genericNbWidgets" val="3"/>{parameter(0, 0, "exposure")}{parameter(1, 4, "sun")}'
    extra += parameter(2, 1, "bounces")
    vector = ('<vector3f name="currentVal"><float name="0" val="1"/><float name="1" val="2"/><float name="2" val="3"/>'
              "</vector3f>")
    widgets = (widget(0, "vector2i", "") + widget(1, "float", '<float name="currentVal" val="0.25"/>')  # 0: the mouse
               + widget(2, "vector3f", vector) + widget(3, "int", '<int name="currentVal" val="7"/>'))
    text = pipeline(node(0, "tracer", body, extra=extra, widget=widgets))
    contract = contract_of(tmp_path, p__gra=text)
    assert contract.values == (("bounces", 7), ("exposure", 0.25), ("sun", (1.0, 2.0, 3.0))) and not contract.unknown
    assert drawn(contract)[0, 0].tolist()[2] == 7.5
    said = read([tmp_path / "p.gra"], values={"exposure": 4.0})
    assert dict(said.values)["exposure"] == 4.0


def test_a_parameter_without_a_value_is_asked_for(tmp_path: Path) -> None:
    extra = f'<uint name="genericNbWidgets" val="1"/>{parameter(0, 0, "exposure")}'
    text = pipeline(node(0, "tracer", SUM.replace("1.0)", "exposure)"), extra=extra))
    assert [one.name for one in contract_of(tmp_path, p__gra=text).unknown] == ["exposure"]


def test_images_and_inputs_that_nobody_feeds(tmp_path: Path) -> None:
    body = SUM.replace("vec4 past", "vec4 sky = texture(inBuffer0, texcoord) + texture(inBuffer1, texcoord); vec4 past")
    image = node(1, "sky", "", "imageInputId", extra='<string name="filename" val="maps/sky.exr"/>')
    contract = contract_of(tmp_path, p__gra=pipeline(node(0, "t", body, inputs=2), image, connections=connection(1, 0)))
    assert [channel.reads for channel in contract.passes[0].channels] == [
        f"file:{tmp_path}/maps/sky.exr", "black", "self"]
    assert any("nothing feeds 'inBuffer1'" in note for note in contract.notes)
    said = read([tmp_path / "p.gra"], values={"inBuffer1": "file:ground.png"})
    assert [(channel.reads, channel.linear) for channel in said.passes[0].channels] == [
        (f"file:{tmp_path}/maps/sky.exr", True), ("file:ground.png", True), ("self", True)]
    assert not any("nothing feeds" in note for note in said.notes)
    with pytest.raises(HarnessError, match=r"p\.gra \(node 't'\): --set inBuffer0: the host feeds that; leave it out"):
        read([tmp_path / "p.gra"], values={"inBuffer0": "black"})
    with pytest.raises(HarnessError, match=r"p\.gra \(node 't'\): --set inBuffer1=ground\.png: a sampler reads"):
        read([tmp_path / "p.gra"], values={"inBuffer1": "ground.png"})


@pytest.mark.parametrize(("text", "says"), [
    ("<Gratin\n<", "p.gra:2: not well-formed XML"), ("\n<Gratin></Gratin>", "no graph of nodes"),
    ("<Gratin/><!DOCTYPE a>", "p.gra:1: '<!DOCTYPE'"), (pipeline(), "no node that holds a shader"),
    (pipeline(node(0, "a", SHOW, "imgGenericId", 1), node(1, "blur", "", "gaussianId"), connections=connection(1, 0)),
     "fed by 'blur', a node of the type 'gaussianId'; only images"),
    (pipeline(node(0, "a", SHOW, "imgGenericId", 1), node(1, "b", SHOW, "imgGenericId", 1),
              connections=connection(1, 0) + connection(0, 1)), "the nodes 'a', 'b' feed each other"),
    (pipeline(node(0, "t", "float x;")), "(node 't'):1: no void main()"), (pipeline(node(0, "t", " ")), "no fragment"),
    (pipeline(node(0, "t", SUM.replace("past +", "pasta +"))), "(node 't'):4: `pasta' undeclared"),
])
def test_what_cannot_be_drawn_is_named(tmp_path: Path, text: str, says: str) -> None:
    refused(tmp_path, says, p__gra=text)


def test_names_of_nodes_that_are_the_same_are_told_apart(tmp_path: Path) -> None:
    text = pipeline(node(0, "n", SUM), node(1, "n", SHOW, "imgGenericId", 1), connections=connection(0, 1))
    (tmp_path / "p.gra").write_text(text)
    contract = read([tmp_path / "p.gra"])
    compiled(contract)
    assert [one.name for one in contract.passes] == ["n", "n 1"]
