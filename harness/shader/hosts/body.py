"""A bare Gratin body, as it stands in a node: `pingpong0`, `numpass`, `texcoord`, `outBuffer0`, and no head."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from harness.errors import ShaderError
from harness.shader.contract import Channel, Contract
from harness.shader.declarations import declarations, entry
from harness.shader.hosts.reading import Answer, Answers, Dialect, Frame, Given, make_contract, make_pass
from harness.shader.includes import joined
from harness.shader.language import GRATIN
from harness.shader.source import ShaderSource

_OWN = re.compile(r"\b(pingpong\d|numpass|outBuffer\d|inBuffer\d)\b")
_VERSION = re.compile(r"^[ \t]*#[ \t]*version\b", re.MULTILINE)
_DECLARED = re.compile(r"\buniform\b[^;]*\b(?:pingpong\d|numpass)\b[^;]*;|\bout\s+vec4\s+outBuffer\d")


def holds(files: Sequence[Given]) -> bool:
    """No version, Gratin's names, and none of them declared: Gratin writes that itself."""
    return all(not _VERSION.search(file.bare) and not _DECLARED.search(file.bare) and _OWN.search(file.bare)
               for file in files)


def read(files: Sequence[Given], answers: Answers) -> Contract:
    """One body that sums, and perhaps one that shows it (`inBuffer0`)."""
    summing = [file for file in files if re.search(r"\bpingpong\d\b", file.bare)]
    others = [file for file in files if file not in summing]
    if len(summing) > 1:
        raise ShaderError(f"{summing[1].name}:1: a second body that reads pingpong0, the first is {summing[0].name}; "
                          "name one, or the pipeline (.gra) that holds both")
    first, *shows = [*summing, *others]
    source = joined([first.piece], GRATIN.macros)
    passes = [make_pass(first.path.stem, source, gratin_frame(source, answers.values), answers)]
    for file in shows:
        source = joined([file.piece], GRATIN.macros)
        frame = gratin_frame(source, answers.values, {"inBuffer0": f"pass:{first.path.stem}"}, displays=True)
        name = file.path.stem if file.path.stem != first.path.stem else f"{file.path.stem} (display)"
        passes.append(make_pass(name, source, frame, answers))
    return make_contract("body", passes, answers)


def gratin_frame(source: ShaderSource, values: Mapping[str, Answer], inputs: Mapping[str, str] = MappingProxyType({}),
                 parameters: Sequence[tuple[str, str]] = (), displays: bool = False,
                 linear: frozenset[str] = frozenset()) -> Frame:
    """The head that Gratin writes before a body, of what the body names.

    `inputs`: what each `inBuffer` reads; `parameters`: (type, name) of the node's. A name that nobody declares but that
    `values` hold is a parameter too. `linear`: samplers that are filtered.
    """
    found = declarations(source, GRATIN.macros)
    entry(source, found)
    head: list[tuple[str, str]] = []
    channels: dict[str, Channel] = {}
    for name in sorted(found.names):
        if re.fullmatch(r"pingpong\d", name):
            channels[name] = Channel(name, "self" if name == "pingpong0" else "black", linear=name in linear)
        elif re.fullmatch(r"inBuffer\d", name) and name in inputs:
            channels[name] = Channel(name, inputs[name], linear=name in linear)
        elif not re.fullmatch(r"inBuffer\d", name):
            continue
        head.append(("sampler2D", name))
    if "numpass" in found.names:
        head.append(("int", "numpass"))
    head += parameters
    named = {name for _, name in head}
    head += [(_type(value), name) for name, value in values.items()
             if name in found.names and name not in found.declared | named and name.isidentifier()
             and not isinstance(value, str)]
    outputs = sorted({0, *(int(name[9:]) for name in found.names if re.fullmatch(r"outBuffer\d", name))})
    lines = [f"layout(location = {index}) out vec4 outBuffer{index};" for index in outputs
             if f"outBuffer{index}" not in found.declared]
    return Frame(GRATIN, {"numpass": "frame"}, channels, head, lines, displays=displays)


def _type(value: Answer) -> str:
    if isinstance(value, tuple):
        return f"vec{len(value)}"
    return "bool" if isinstance(value, bool) else "int" if isinstance(value, int) else "float"


DIALECT = Dialect("body", "a Gratin node's body without its head", holds, read)
