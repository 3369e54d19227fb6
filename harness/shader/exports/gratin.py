"""Gratin: a pipeline of two nodes, one that sums in a ping-pong and one that shows, with parameters to turn.

The elements and attributes are those that Gratin 0.3 saves. It writes the head of a shader itself: version, outputs,
inputs, parameters, `pingpong0` and `numpass`; the text here is what comes after.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from harness.scene.model import Scene, is_black
from harness.shader.exports.base import Job
from harness.shader.exports.images import Image, images_of, loaded, with_lookups
from harness.shader.exports.readable import Text, item

HOST = "gratin"
PASSES = 64  # that Gratin draws when the pipeline is opened, and each time that something is changed
# Gratin's widgets for a number, and what a slider divides its range into.
SLIDER, SPIN = 1, 2
MAX_EXPOSURE = 16.0  # stops, either way
_NEAREST, _CLAMP, _LESS, _ONE, _ZERO = 9728, 33071, 513, 1, 0  # GL's constants
_VERTEX = """out vec2 texcoord;

void main()
{
    gl_Position = vec4(vertex, 0, 1);
    texcoord = coord;
}
"""
_MATERIAL = re.compile(r"(?P<before>(?:if \((?P<ids>[^)]*)\) value|Material value) = Material\(vec3\([^)]*\), "
                       r"vec3\([^)]*\)), (?P<alpha>[^,()]+)(?P<after>, [^,()]+\);)")


@dataclass(frozen=True)
class Parameter:
    """A node's float: a uniform of that name. A slider has a thousand steps, a spin box two decimals."""

    name: str
    value: float
    lowest: float
    highest: float
    view: int

    @classmethod
    def around(cls, name: str, value: float) -> Parameter:
        """A slider in whose very middle the value lies, which Gratin then keeps to the bit."""
        return cls(name, value, 0.0, 2 * value or 1.0, SLIDER)


@dataclass(frozen=True)
class GratinNode:
    """A node: `kind`, Gratin's word for it; `inputs`: its samplers; `size`: of what it draws, `passes` 0 for one that
    is drawn once and takes its first input's size."""

    kind: str
    name: str
    inputs: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    body: str
    size: tuple[int, int]
    passes: int
    place: int


def export(job: Job) -> dict[str, str]:
    """`NAME.gra`."""
    images = images_of(job.scene)
    lookups, tracer = with_lookups(job.tracer(), images, lambda index, image: loaded(image, _input(index)))
    tracer, parameters = _with_parameters(tracer, job.scene)
    size = job.scene.width, job.scene.height
    nodes = [
        GratinNode("pingPongGenericId", "pathTracer", tuple(map(_input, range(len(images)))), tuple(parameters),
                   _tracer_body(job, images, lookups, tracer), size, PASSES, 0),
        GratinNode("imgGenericId", "display", ("inBuffer0",),
                   (Parameter("exposure", job.exposure, -MAX_EXPOSURE, MAX_EXPOSURE, SPIN),), _display_body(job), size,
                   0, 300),
    ]
    root = _pipeline(nodes)
    ElementTree.indent(root, "")
    text = ElementTree.tostring(root, encoding="unicode", short_empty_elements=True)
    return {f"{job.name}.gra": text + "\n"}


def _tracer_body(job: Job, images: Sequence[Image], lookups: str, tracer: Text) -> str:
    how = ["Open the file in Gratin. This node draws passes and sums them; the node 'display' shows the mean."]
    if images:
        how.append("Its inputs wait for nodes that load an image: "
                   + ", ".join(f"{_input(index)} for {image.file}" for index, image in enumerate(images)) + ".")
    main = f"""// ==== the pass {"=" * 100}

in vec2 texcoord;

const int SAMPLES = {job.frame_samples};  // per pixel and pass

void main()
{{
    ivec2 size = textureSize(pingpong0, 0);
    uvec2 pixel = uvec2(texcoord * vec2(size));
    vec4 sum = numpass > 0 ? texelFetch(pingpong0, ivec2(pixel), 0) : vec4(0.0);  // before pass 0 it holds anything
    outBuffer0 = trace_samples(sum, pixel, vec2(size), 0u, uint(numpass) * uint(SAMPLES), SAMPLES);
}}
"""
    return "\n".join([job.head(*how), *([lookups] if lookups else []), tracer.written(), main])


def _input(index: int) -> str:
    """Gratin's own name of a node's input."""
    return f"inBuffer{index}"


def _display_body(job: Job) -> str:
    return f"""in vec2 texcoord;

{job.encode()}
void main()
{{
    vec4 sum = texelFetch(inBuffer0, ivec2(texcoord * vec2(textureSize(inBuffer0, 0))), 0);
    vec3 mean = sum.a > 0.0 ? sum.rgb / sum.a : vec3(0.0);
    outBuffer0 = vec4(encode_srgb(mean * exp2(exposure)), 1.0);
}}
"""


def _with_parameters(tracer: Text, scene: Scene) -> tuple[Text, list[Parameter]]:
    """The tracer with parameters in place of the lens's and the exponents' numbers."""
    parameters: list[Parameter] = []
    items = []
    for one in tracer.items:
        code = one.code
        for constant, name in (("CAMERA_APERTURE", "aperture"), ("CAMERA_FOCUS", "focal_distance")):
            if found := re.fullmatch(rf"const float {constant} = (.+);", code):
                parameters.append(Parameter.around(name, float(np.float32(found[1]))))
                code = f"#define {constant} {name}  // a parameter of the node"
        if "material" in one.names and "(" in code:
            code, exponents = _with_exponents(code, scene)
            parameters += exponents
        items.append(item(one.file, code, one.comment))
    return Text(tracer.about, tuple(items)), parameters


def _with_exponents(code: str, scene: Scene) -> tuple[str, list[Parameter]]:
    """The function `material` with a parameter for the exponent of each glossy material that has a constant one."""
    named = {int(index) for match in _MATERIAL.finditer(code) for index in re.findall(r"\d+", match["ids"] or "")}
    parameters: list[Parameter] = []

    def replaced(match: re.Match[str]) -> str:
        ids = [int(index) for index in re.findall(r"\d+", match["ids"] or "")] or [
            index for index in range(len(scene.shapes)) if index not in named]
        glossy = [index for index in ids if not is_black(scene.shapes[index].material.ks)
                  and isinstance(scene.shapes[index].material.alpha, float | int)]
        if not glossy:
            return match[0]
        words = re.sub(r"[^A-Za-z0-9]+", "_", scene.shapes[glossy[0]].name).strip("_") or f"shape_{glossy[0]}"
        taken = {parameter.name for parameter in parameters}
        names = itertools.chain([f"exponent_{words}"], (f"exponent_{words}_{count}" for count in itertools.count(2)))
        name = next(name for name in names if name not in taken)  # shapes may share a name
        parameters.append(Parameter.around(name, float(np.float32(match["alpha"]))))
        return f"{match['before']}, {name}{match['after']}"

    return _MATERIAL.sub(replaced, code), parameters


def _pipeline(nodes: Sequence[GratinNode]) -> Element:
    root = Element("Gratin", type="pipeline")
    _leaf(root, "int", "majorVersion", 0)
    _leaf(root, "int", "minorVersion", 3)
    window = _group(root, "mainWindow")
    graph_widget = _group(window, "graphWidget")
    graph = _group(graph_widget, "graph")
    _leaf(graph, "uint", "nbNodes", len(nodes))
    for number, node in enumerate(nodes):
        _node(graph, number, node)
    _leaf(graph, "uint", "nbConnections-0-1", 1)
    _vector(graph, "uint", "connection-0-1-0", (0, 0))
    _view(graph_widget)
    animation = _group(graph_widget, "animation")
    for name, value in (("firstFrame", 0), ("lastFrame", 99), ("currentFrame", 0), ("fps", 24)):
        _leaf(animation, "uint", name, value)
    animation_widget = _group(window, "animationWidget")
    _vector(animation_widget, "int", "animationWidgetSize", (1024, 300))
    _group(animation_widget, "timelineWidget")
    _group(window, "nodeListWidget")
    _view(_group(window, "interactionWidget"))
    _group(window, "nodeInterfaceWidget")
    return root


def _node(graph: Element, number: int, node: GratinNode) -> None:
    def leaf(kind: str, name: str, value: object) -> None:
        _leaf(graph, kind, f"{name}-{number}", value)

    leaf("string", "nodeStringId", node.kind)
    leaf("uint", "nodeVersion", 1)
    leaf("string", "nodeName", node.name)
    leaf("string", "nodePath", "Generic/")
    leaf("string", "nodeDesc", "")
    leaf("string", "nodeHelp", "")
    leaf("uint", "nodeId", number)
    leaf("uint", "nodeGraphId", 0)
    _vector(graph, "float", f"nodePos-{number}", (node.place, 0))
    leaf("int", "nodeInputNameSize", len(node.inputs))
    leaf("int", "nodeOutputNameSize", 1)
    for index, name in enumerate(node.inputs):
        _leaf(graph, "string", f"nodeInputName-{number}-{index}", name)
    _leaf(graph, "string", f"nodeOutputName-{number}-0", "outBuffer0")
    leaf("bool", "nodeHasWidget", 1)
    _shader(_group(graph, f"node-{number}"), node)
    widget = _group(graph, f"nodeWidget-{number}")
    _leaf(widget, "uint", "nbChildren", len(node.parameters))
    for index, parameter in enumerate(node.parameters):
        _widget(_group(widget, f"childWidget-{index}"), parameter)
    _vector(graph, "float", f"nodeOutputPos-{number}-0", (node.place + 56, 28))


def _shader(data: Element, node: GratinNode) -> None:
    _leaf(data, "string", "genericGlslVersion", 420)
    _leaf(data, "string", "genericNodeName", node.name)
    for stage in ("Vertex", "Tesselation", "Geometry", "Fragment"):
        _leaf(data, "bool", f"genericUse{stage}", int(stage == "Fragment"))
    for kind, name, value in _settings():
        _leaf(data, kind, name, value)
    _vector(data, "float", "genericBackground", (0, 0, 0, 0))
    empty = "void main(){}\n"
    for stage, body in (("Vert", _VERTEX), ("Frag", node.body), ("TessC", empty), ("TessE", empty), ("Geom", empty)):
        _leaf(data, "string", f"generic{stage}Head", "")
        _leaf(data, "string", f"generic{stage}Body", body)
    # A size of its own, or one time the first input's.
    _vector(data, "float", "genericTSize", (0, 0) if node.passes else (1, 1))
    _vector(data, "float", "genericTOffset", node.size if node.passes else (0, 0))
    _leaf(data, "bool", "genericNeedMouse", 0)
    _leaf(data, "bool", "genericNeedKeyboard", 0)
    _leaf(data, "uint", "genericNbWidgets", len(node.parameters))
    for index, parameter in enumerate(node.parameters):
        _leaf(data, "int", f"genericWidgetType-{index}", 0)  # a float
        _leaf(data, "int", f"genericWidgetView-{index}", parameter.view)
        _leaf(data, "string", f"genericWidgetName-{index}", parameter.name)
        _leaf(data, "bool", f"genericWidgetKeyframed-{index}", 0)
    if node.passes:
        _leaf(data, "int", "pingPongNumber", node.passes)
        for name, value in (("UpdateOnceChanged", 0), ("UpdateAllChanged", 0), ("ReinitWhenChanged", 1),
                            ("RefreshAllFrames", 1)):
            _leaf(data, "bool", f"pingPong{name}", value)


def _settings() -> Iterator[tuple[str, str, int]]:
    yield from (("int", "genericOutFilter", _NEAREST), ("int", "genericOutWrap", _CLAMP),
                ("bool", "genericUseDepthTest", 0), ("bool", "genericUseBlending", 0),
                ("uint", "genericDepthFunc", _LESS), ("uint", "genericBlendSrc", _ONE),
                ("uint", "genericBlendDst", _ZERO))


def _widget(data: Element, parameter: Parameter) -> None:
    _leaf(data, "bool", "floatAttribKeyframed", 0)
    _leaf(data, "float", "floatAttribMinVal", _float(parameter.lowest))
    _leaf(data, "float", "floatAttribMaxVal", _float(parameter.highest))
    value = _group(data, "floatAttribCurve")
    _leaf(value, "float", "currentVal", _float(parameter.value))
    _leaf(value, "uint", "nbCurves", 1)
    curve = _group(value, "curve-0")
    for name in ("interpType", "leftType", "rightType"):
        _leaf(curve, "int", name, 0)  # linear between its points, constant beyond
    points = _group(curve, "interpolator")
    _leaf(points, "uint", "nbPoints", 1)
    _leaf(points, "uint", "nbTangents", 0)
    _vector(points, "float", "controlPoint-0", (0, _float(parameter.value)))
    _leaf(data, "uint", "nbChildren", 0)


def _view(data: Element) -> None:
    _leaf(data, "float", "scale", 1)
    _vector(data, "float", "offset", (0, 0))


def _group(parent: Element, name: str) -> Element:
    return SubElement(parent, "IOData", name=name)


def _leaf(parent: Element, kind: str, name: str, value: object) -> None:
    SubElement(parent, kind, name=name, val=str(value))


def _vector(parent: Element, kind: str, name: str, values: Sequence[object]) -> None:
    group = SubElement(parent, f"vector{len(values)}{kind[0]}", name=name)
    for index, value in enumerate(values):
        _leaf(group, kind, str(index), value)


def _float(value: float) -> str:
    """The shortest decimal that reads back as the same float32, without a fraction where it has none."""
    return np.format_float_positional(np.float32(value), trim="-")
