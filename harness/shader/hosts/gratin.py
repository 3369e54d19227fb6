"""Gratin pipelines (.gra): XML with the nodes' shaders, their parameters' values, and who feeds whom.

The format is that of Gratin 0.3.1's own SceneSaver; a parameter's value stands in its widget, not beside its name.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePath

from harness.errors import ShaderError
from harness.shader.contract import Channel, Contract, Value
from harness.shader.hosts.body import gratin_frame
from harness.shader.hosts.reading import Answers, Dialect, Given, make_contract, make_pass, said_channel
from harness.shader.includes import Piece, joined
from harness.shader.language import GRATIN

# The nodes that hold a shader, and whether they sum.
_SHADERS = {"imgGenericId": False, "pingPongGenericId": True}
# genericWidgetType, by WidgetFactory's numbers: the uniform's type, and its attribute widget's name.
_TYPES = (("float", "float"), ("int", "int"), ("vec2", "vector2f"), ("ivec2", "vector2i"), ("vec3", "vector3f"),
          ("ivec3", "vector3i"), ("vec4", "vector4f"), ("ivec4", "vector4i"))
_IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".exr", ".hdr", ".pfm", ".tga")
_LINEAR = 9729  # GL_LINEAR
_ITS_OWN_VERTEX = re.compile(r"out vec2 texcoord;\s*void main\(\)\s*\{\s*gl_Position = vec4\(vertex,\s*0,\s*1\);\s*"
                             r"texcoord = coord;\s*\}")


@dataclass(frozen=True)
class Parameter:
    """A node's parameter: a uniform's type and name, and its value where the file has one."""

    kind: str
    name: str
    value: Value | None


@dataclass
class Node:
    """A node of the graph. `inputs`: the index of the node that feeds each of its inputs."""

    index: int
    name: str
    kind: str
    data: ET.Element
    input_names: Sequence[str] = ()
    parameters: Sequence[Parameter] = ()
    inputs: dict[int, int] = field(default_factory=dict)

    def value(self, name: str, default: str = "") -> str:
        """One of its settings."""
        return _value(self.data, name, default)


def holds(files: Sequence[Given]) -> bool:
    """XML whose outermost element is Gratin."""
    return len(files) == 1 and re.match(r"(?:<\?xml[^>]*\?>\s*|<!--.*?-->\s*)*<Gratin\b", files[0].text.lstrip(),
                                        re.DOTALL) is not None


def read(files: Sequence[Given], answers: Answers) -> Contract:
    """The shader nodes of one pipeline, in the order in which they feed each other."""
    file = files[0]
    nodes = _nodes(file)
    drawn = _in_order([node for node in nodes if node.kind in _SHADERS], file)
    if not drawn:
        raise ShaderError(f"{file.name}:1: no node that holds a shader; put a path tracer into a ping-pong node")
    fed = {source for node in drawn for source in node.inputs.values()}
    names = _names(drawn)
    passes = []
    for node in drawn:
        sums = _SHADERS[node.kind]
        inputs, linear = _inputs(node, nodes, names, file, answers)
        piece = Piece(f"{file.name} (node '{node.name}')", node.value("genericFragBody"))
        source = joined([piece], GRATIN.macros)
        if not piece.text.strip():
            raise ShaderError(f"{piece.name}:1: the node has no fragment shader; write one into it")
        if node.value("genericUseVertex") == "1" and not _ITS_OWN_VERTEX.search(node.value("genericVertBody")):
            answers.note(f"{piece.name}: its own vertex shader is left out; a triangle over the whole image is drawn")
        known = {parameter.name for parameter in node.parameters}
        values = {name: value for name, value in answers.values.items() if name not in known}
        for parameter in node.parameters:
            said = answers.take(parameter.name)
            if said is None and parameter.value is not None and (
                    answers.kept.setdefault(parameter.name, parameter.value) != parameter.value):
                answers.note(f"{piece.name}: '{parameter.name}' has another value in an earlier node; that is taken")
        frame = gratin_frame(source, values, inputs, [(one.kind, one.name) for one in node.parameters],
                             displays=not sums and node.index not in fed and len(drawn) > 1, linear=linear)
        passes.append(make_pass(names[node.index], source, frame, answers))
        width, height = _pair(node.data, "genericTOffset")
        if sums and width > 1 and height > 1:
            answers.note(f"{piece.name}: Gratin draws it at {width} x {height}, {node.value('pingPongNumber', '1')} "
                         "passes at a time")
    return make_contract("gratin", passes, answers)


def _nodes(file: Given) -> list[Node]:
    if found := re.search(r"<!(?:DOCTYPE|ENTITY)", file.text):
        line = file.text.count("\n", 0, found.start()) + 1
        raise ShaderError(f"{file.name}:{line}: '{found[0]}', which Gratin never writes; save the pipeline anew")
    try:
        root = ET.fromstring(file.text.lstrip())
    except ET.ParseError as error:
        lead = file.text[:len(file.text) - len(file.text.lstrip())].count("\n")
        raise ShaderError(f"{file.name}:{error.position[0] + lead}: not well-formed XML "
                          f"({str(error).partition(':')[0]}); save the pipeline anew from Gratin") from None
    graph = root.find(".//IOData[@name='graph']")
    if graph is None:
        raise ShaderError(f"{file.name}:1: no graph of nodes in it; save the pipeline anew from Gratin")
    return list(_read_nodes(graph))


def _read_nodes(graph: ET.Element) -> Iterator[Node]:
    for index in range(_integer(graph, "nbNodes")):
        data = graph.find(f"IOData[@name='node-{index}']")
        data = ET.Element("IOData") if data is None else data
        widget = graph.find(f"IOData[@name='nodeWidget-{index}']")
        names = [_value(graph, f"nodeInputName-{index}-{number}")
                 for number in range(_integer(graph, f"nodeInputNameSize-{index}"))]
        node = Node(index, _value(graph, f"nodeName-{index}", f"node {index}"), _value(graph, f"nodeStringId-{index}"),
                    data, names, list(_parameters(data, widget)))
        for element in graph:
            if found := re.fullmatch(rf"connection-(\d+)-{index}-\d+", element.get("name", "")):
                pair = [int(part.get("val", "0")) for part in element]
                if len(pair) == 2:  # the source's output, this node's input
                    node.inputs[pair[1]] = int(found[1])
        yield node


def _parameters(data: ET.Element, widget: ET.Element | None) -> Iterator[Parameter]:
    """The node's parameters; their widgets follow those of the mouse and the keyboard, in the same order."""
    children = [] if widget is None else [child for child in widget if child.get("name", "").startswith("childWidget")]
    count = _integer(data, "genericNbWidgets")
    children = children[len(children) - count:] if len(children) >= count else []
    for index in range(count):
        number = _integer(data, f"genericWidgetType-{index}")
        if not 0 <= number < len(_TYPES):
            continue
        kind, attribute = _TYPES[number]
        curve = children[index].find(f".//IOData[@name='{attribute}AttribCurve']") if children else None
        yield Parameter(kind, _value(data, f"genericWidgetName-{index}", f"widget{index}"),
                        None if curve is None else _current(curve))


def _current(curve: ET.Element) -> Value | None:
    for element in curve:
        if element.get("name") == "currentVal":
            try:
                numbers = [float(part.get("val", "")) for part in (list(element) or [element])]
            except ValueError:
                return None
            whole = element.tag in ("int", "uint")
            return tuple(numbers) if len(numbers) > 1 else int(numbers[0]) if whole else numbers[0]
    return None


def _names(drawn: Sequence[Node]) -> dict[int, str]:
    """Names of passes: those of the nodes, told apart where two are the same."""
    names: dict[int, str] = {}
    for node in drawn:
        names[node.index] = node.name if node.name not in names.values() else f"{node.name} {node.index}"
    return names


def _in_order(drawn: Sequence[Node], file: Given) -> list[Node]:
    """Each node behind those that feed it."""
    result: list[Node] = []
    left = list(drawn)
    while left:
        ready = [node for node in left if not any(other.index in node.inputs.values() for other in left)]
        if not ready:
            raise ShaderError(f"{file.name}:1: the nodes {', '.join(repr(node.name) for node in left)} feed each other "
                              "in a circle; only a ping-pong node may read its own past")
        result += ready
        left = [node for node in left if node not in ready]
    return result


def _inputs(node: Node, nodes: Sequence[Node], names: Mapping[int, str], file: Given,
            answers: Answers) -> tuple[dict[str, str], frozenset[str]]:
    """What each `inBuffer` of a node reads, and the samplers that are filtered."""
    inputs: dict[str, str] = {}
    linear = {"pingpong0"} if node.value("genericOutFilter") == str(_LINEAR) else set()
    for number, _ in enumerate(node.input_names):
        name = f"inBuffer{number}"
        source = next((other for other in nodes if other.index == node.inputs.get(number)), None)
        if source is None:
            where = f"{file.name} (node '{node.name}')"
            said = answers.take(name)
            inputs[name] = "black" if said is None else said_channel(name, said, Channel(name, "black"), where).reads
            if said is not None:
                linear.add(name)
            elif name in node.value("genericFragBody"):
                answers.note(f"{where}: nothing feeds '{name}'; it reads black; for an image, --set {name}=file:PATH")
        elif source.index in names:
            inputs[name] = f"pass:{names[source.index]}"
            if source.value("genericOutFilter") == str(_LINEAR):
                linear.add(name)
        elif image := _image(source):
            inputs[name] = f"file:{file.path.parent / PurePath(image)}"
            linear.add(name)  # as all textures of Gratin's
        else:
            raise ShaderError(f"{file.name}:1: '{name}' of the node '{node.name}' is fed by '{source.name}', a node of "
                              f"the type '{source.kind}'; only images and the types {' and '.join(_SHADERS)} are known")
    return inputs, frozenset(linear)


def _image(node: Node) -> str:
    """The image that a node loads, '' for none."""
    for element in node.data.iter("string"):
        if (value := element.get("val", "")).lower().endswith(_IMAGES):
            return value.replace("\\", "/")
    return ""


def _value(parent: ET.Element, name: str, default: str = "") -> str:
    element = next((element for element in parent if element.get("name") == name), None)
    return default if element is None else element.get("val", default)


def _integer(parent: ET.Element, name: str) -> int:
    value = _value(parent, name, "0")
    return min(int(value), 10_000) if value.isdecimal() and len(value) < 10 else 0


def _pair(parent: ET.Element, name: str) -> tuple[int, int]:
    element = next((element for element in parent if element.get("name") == name), None)
    try:
        numbers = [round(float(part.get("val", "0"))) for part in element] if element is not None else []
    except (ValueError, OverflowError):
        numbers = []
    return (numbers[0], numbers[1]) if len(numbers) == 2 else (0, 0)


DIALECT = Dialect("gratin", "a Gratin pipeline (.gra)", holds, read)
