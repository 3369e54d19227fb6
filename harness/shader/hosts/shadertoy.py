"""Shadertoy: exports (JSON, of its API and of its page), folders, and files named after its tabs.

Its contract, as the page's own code has it: ES 3.00, `mainImage`, buffers A to D drawn in this order and then the
image, each reading what the last frame left in buffers that come later, or in itself.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from harness.errors import ShaderError
from harness.shader.contract import Channel, Contract, Role, ShaderPass
from harness.shader.declarations import declarations, entry
from harness.shader.hosts.reading import (
    STAND_INS,
    Answers,
    Dialect,
    Frame,
    Given,
    make_contract,
    make_pass,
    said_channel,
)
from harness.shader.hosts.written import written_size
from harness.shader.includes import Piece, joined
from harness.shader.language import GLES_300
from harness.shader.source import ShaderSource

UNIFORMS: Mapping[str, tuple[str, Role]] = {
    "iResolution": ("vec3", "resolution"), "iTime": ("float", "time"), "iGlobalTime": ("float", "time"),
    "iTimeDelta": ("float", "time_delta"), "iFrame": ("int", "frame"), "iFrameRate": ("float", "frame_rate"),
    "iMouse": ("vec4", "mouse"), "iMouseButton": ("vec4", "mouse"), "iDate": ("vec4", "date"),
}
CHANNELS = tuple(f"iChannel{number}" for number in range(4))
BUFFERS = tuple(f"Buffer {letter}" for letter in "ABCD")
# What its inputs read here; those of buffers are told by their numbers.
_INPUTS = {"keyboard": "keyboard", "texture": "noise", "cubemap": "cube", "volume": "volume", "music": "black",
           "musicstream": "black", "mic": "black", "webcam": "noise", "video": "noise"}
_KINDS = {"cubemap": "samplerCube", "volume": "sampler3D"}
# As arrays of the page, from what a shader can ask by itself.
_SIZES = "vec3[4](" + ", ".join(f"vec3(textureSize({name}, 0).xy, 1.0)" for name in CHANNELS) + ")"
_MACROS = {"iChannelResolution": f"({_SIZES})", "iChannelTime": "(float[4](iTime, iTime, iTime, iTime))",
           "iSampleRate": "44100.0"}
_MAIN = ("\nvoid main() {\n    vec4 color = vec4(0.0, 0.0, 0.0, 1.0);\n    mainImage(color, gl_FragCoord.xy);\n"
         "    harness_pixel = color;\n}\n")
_OUTPUT = "layout(location = 0) out vec4 harness_pixel;"
_TAB = re.compile(r"(?:^|[^a-z])(?:(?P<image>image|main_?image|main)|(?P<common>common)|"
                  r"buf(?:fer)?[ _.-]?(?P<buffer>[a-d]|[0-3]))$")

_LEFT_OUT = re.compile(r"(?:sound|cube[ _-]?map(?:[ _-]?a)?)$", re.IGNORECASE)


@dataclass
class Tab:
    """One pass of a Shadertoy: what its channels read."""

    name: str
    pieces: Sequence[Piece]
    channels: dict[str, Channel] = field(default_factory=dict)


def holds(files: Sequence[Given]) -> bool:
    """An export, or files with `mainImage` and no `main`."""
    if len(files) == 1 and (files[0].text.lstrip()[:1] in ("{", "[")):
        return True
    return any(re.search(r"\bvoid\s+mainImage\s*\(", file.bare) for file in files) and not any(
        re.search(r"\bvoid\s+main\s*\(", file.bare) for file in files)


def read(files: Sequence[Given], answers: Answers) -> Contract:
    """The passes of an export, or of files named after the tabs of the page."""
    export = files[0].text.lstrip()[:1] in ("{", "[")
    tabs = _exported(files[0], answers) if export else _tabs(files, answers)
    return contract_of(tabs, answers, "shadertoy")


def contract_of(tabs: Sequence[Tab], answers: Answers, host: str) -> Contract:
    """The contract of these passes, the image last."""
    passes = [toy_pass(tab, joined(tab.pieces, GLES_300.macros), answers, tab.name == "Image" and len(tabs) > 1)
              for tab in tabs]
    texts = [one.source.text for one in passes]
    asks = any("iResolution" in text or "textureSize" in text for text in texts)
    size = None if asks else next((size for text in texts if (size := written_size(text))), None)
    return make_contract(host, passes, answers, size)


def toy_pass(tab: Tab, source: ShaderSource, answers: Answers, displays: bool) -> ShaderPass:
    """One pass, with the head that the page writes."""
    found = declarations(source, GLES_300.macros)
    main = entry(source, found)
    needed = {name for name in found.names if name in (*UNIFORMS, *CHANNELS)}
    if "iChannelResolution" in found.names and "iChannelResolution" not in found.declared:
        needed |= set(CHANNELS)
    if "iChannelTime" in found.names:
        needed.add("iTime")
    channels = {name: tab.channels.get(name, Channel(name, "black")) for name in CHANNELS}
    for name in CHANNELS:
        said = answers.take(f"{tab.name}.{name}") or answers.take(name)
        if said is not None:
            channels[name] = said_channel(name, "self" if said == f"pass:{tab.name}" else said, channels[name],
                                          source.files[-1][0])
    head = [(channels[name].kind, name) for name in CHANNELS if name in needed]
    head += [(kind, name) for name, (kind, _) in UNIFORMS.items() if name in needed]
    defines = {"HW_PERFORMANCE": "1", **{name: value for name, value in _MACROS.items()
                                         if name in found.names and name not in found.declared}}
    frame = Frame(GLES_300, {name: role for name, (_, role) in UNIFORMS.items()}, channels, head,
                  [_OUTPUT] if main == "mainImage" else [], defines, _MAIN if main == "mainImage" else "", zero=True,
                  displays=displays)
    return make_pass(tab.name, source, frame, answers)


def _exported(file: Given, answers: Answers) -> list[Tab]:
    """The passes of an export: the API's `{"Shader": {"renderpass": …}}`, the page's, or a list of one of them."""
    try:
        data = json.loads(file.text)
    except json.JSONDecodeError as error:
        raise ShaderError(f"{file.name}:{error.lineno}: not JSON ({error.msg}); export the shader anew") from None
    except RecursionError:
        raise ShaderError(f"{file.name}:1: JSON nested too deeply for an export of Shadertoy; export the shader "
                          "anew") from None
    if isinstance(data, list) and len(data) == 1:
        data = data[0]
    data = data.get("Shader", data) if isinstance(data, dict) else data
    rendered = data.get("renderpass") if isinstance(data, dict) else None
    if not isinstance(rendered, list) or not all(isinstance(one, dict) and isinstance(one.get("code"), str)
                                                 for one in rendered):
        raise ShaderError(f"{file.name}:1: JSON, but no export of one Shadertoy (no 'renderpass' with 'code' in it); "
                          "export the shader anew, or name its GLSL files")
    common = [Piece(f"{file.name} (Common)", one["code"]) for one in rendered if one.get("type") == "common"]
    drawn = sorted((one for one in rendered if one.get("type") in ("buffer", "image", None)),
                   key=lambda one: (one.get("type") == "image", str(one.get("name", ""))))
    if not drawn:
        raise ShaderError(f"{file.name}:1: an export without an image or a buffer; export the shader anew")
    for one in rendered:
        if one.get("type") in ("sound", "cubemap"):
            answers.note(f"{file.name}: its {one['type']} pass is left out")
    names = [_tab_name(one, index) for index, one in enumerate(drawn)]
    writers = {str(output.get("id")): name for one, name in zip(drawn, names, strict=True)
               for output in _list(one, "outputs") if one.get("type") != "image"}
    return [Tab(name, [*common, Piece(f"{file.name} ({name})", one["code"])],
                _wiring(file, one, name, writers, names)) for one, name in zip(drawn, names, strict=True)]


def exported(text: str) -> list[tuple[str, str, Callable[[str], str]]]:
    """The texts of an export, each with its pass's name and with what makes the export of another in its place; none of
    JSON that is no export."""
    def passes(data: Any) -> list[dict[str, Any]]:
        data = data[0] if isinstance(data, list) and len(data) == 1 else data
        data = data.get("Shader", data) if isinstance(data, dict) else data
        return _list(data, "renderpass") if isinstance(data, dict) else []

    def whole(index: int, code: str) -> str:
        data = json.loads(text)
        passes(data)[index]["code"] = code
        return json.dumps(data)

    try:
        found = passes(json.loads(text))
    except (json.JSONDecodeError, RecursionError):
        return []
    return [(str(one.get("name", "")) or "Image", one["code"], partial(whole, index))
            for index, one in enumerate(found) if isinstance(one.get("code"), str)]


def _tab_name(one: Mapping[str, Any], index: int) -> str:
    if one.get("type") == "image":
        return "Image"
    found = re.search(r"[A-Da-d]$", str(one.get("name", "")).strip())
    return f"Buffer {found[0].upper()}" if found else f"Buffer {'ABCD'[index % 4]}"


def _list(one: Mapping[str, Any], key: str) -> list[dict[str, Any]]:
    value = one.get(key)
    return [entry for entry in value if isinstance(entry, dict)] if isinstance(value, list) else []


def _wiring(file: Given, one: Mapping[str, Any], name: str, writers: Mapping[str, str],
            names: Sequence[str]) -> dict[str, Channel]:
    """What each channel of an exported pass reads; of two inputs on one channel the last counts, as on the page."""
    channels: dict[str, Channel] = {}
    for given in _list(one, "inputs"):
        kind = str(given.get("ctype") or given.get("type") or "")
        sampler = f"iChannel{given.get('channel')}"
        setting = given.get("sampler") if isinstance(given.get("sampler"), dict) else {}
        reads = _INPUTS.get(kind, "black")
        if kind == "buffer":
            path = re.search(r"buffer0([0-3])", str(given.get("src") or given.get("filepath") or ""))
            target = writers.get(str(given.get("id"))) or (f"Buffer {'ABCD'[int(path[1])]}" if path else "")
            if target not in names and not re.search(rf"\b{sampler}\b", one["code"]):
                continue
            if target not in names:
                raise ShaderError(f"{file.name} ({name}): {sampler} reads a buffer that no pass writes (id "
                                  f"{given.get('id')}); there are {', '.join(names)}; export the shader anew")
            reads = "self" if target == name else f"pass:{target}"
        assert isinstance(setting, dict)
        channels[sampler] = Channel(sampler, reads, _KINDS.get(kind, "sampler2D"),
                                    setting.get("filter") in ("linear", "mipmap"), setting.get("wrap") == "repeat")
    return channels


def tab_of(file: Given) -> str:
    """'Image', 'Common' or 'Buffer A' to 'Buffer D' by a file's name; '' where it says none."""
    found = _TAB.search(file.path.stem.lower())
    if not found:
        return ""
    if found["buffer"]:
        return f"Buffer {'ABCD'[int(found['buffer'])] if found['buffer'].isdecimal() else found['buffer'].upper()}"
    return "Image" if found["image"] else "Common"


def _tabs(files: Sequence[Given], answers: Answers) -> list[Tab]:
    """Passes from files. No file says what a channel reads, so this is said in a note, and may be said otherwise."""
    named: dict[str, Given] = {}
    for file in files:
        if len(files) > 1 and _LEFT_OUT.search(file.path.stem):
            answers.note(f"{file.name}: this pass is left out")
            continue
        name = tab_of(file) or ("Image" if len(files) == 1 else "")
        if len(files) == 1 and name == "Common":
            name = "Image"
        if not name or name in named:
            other = f", and so does {named[name].name}" if name in named else ""
            raise ShaderError(f"{file.name}: its name says {f'{name}{other}' if name else 'no tab of Shadertoy'}; call "
                              "the files image, bufferA to bufferD, and common")
        named[name] = file
    common = [named.pop("Common").piece] if "Common" in named else []
    order = sorted(named, key=lambda name: (name == "Image", name))
    buffers = [name for name in order if name != "Image"]
    tabs = []
    for name in order:
        tab = Tab(name, [*common, named[name].piece])
        used = [channel for channel in CHANNELS if re.search(rf"\b{channel}\b", named[name].bare)]
        for channel in used:
            if f"{name}.{channel}" in answers.values or channel in answers.values:
                continue
            number = int(channel[-1])
            reads = name if not buffers and number == 0 else buffers[number] if number < len(buffers) else ""
            tab.channels[channel] = Channel(channel, "black" if not reads else "self" if reads == name
                                            else f"pass:{reads}")
            if _looks_up_directions(channel, named[name].bare):
                tab.channels[channel], reads = Channel(channel, "cube", "samplerCube"), ""
            said = "its own last frame" if reads == name else reads or tab.channels[channel].reads
            answers.note(f"{named[name].name}: {channel} is taken to read {said}; else say "
                         f"--set '{name}.{channel}=…' ({', '.join(STAND_INS)}, pass:NAME)")
        tabs.append(tab)
    return tabs


def _looks_up_directions(channel: str, text: str) -> bool:
    """Whether a channel is looked up by a name that is a vec3 wherever it is declared: then it is a cube map."""
    names = re.findall(rf"\btexture(?:Lod|Cube)?\s*\(\s*{channel}\s*,\s*(\w+)\s*[,)]", text)
    return any(re.search(rf"\bvec3\s+{name}\b", text) and not re.search(rf"\b(?:vec2|float)\s+{name}\b", text)
               for name in names)


DIALECT = Dialect("shadertoy", "a Shadertoy: its export (JSON), or its tabs as files", holds, read)
