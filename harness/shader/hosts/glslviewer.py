"""glslViewer: one file, compiled once a pass, each with another macro defined (`DOUBLE_BUFFER_0`)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from harness.errors import ShaderError
from harness.shader.conditionals import preprocess
from harness.shader.contract import Channel, Contract, Role
from harness.shader.declarations import declarations, entry
from harness.shader.hosts.reading import Answers, Dialect, Frame, Given, make_contract, make_pass
from harness.shader.includes import joined
from harness.shader.language import OLDEST, Language, said_version

_ROLES: dict[str, Role] = {
    "u_resolution": "resolution", "u_time": "time", "u_delta": "time_delta", "u_date": "date", "u_mouse": "mouse",
    "u_frame": "frame",
}
_BUFFER = re.compile(r"\b(?:(?P<double>DOUBLE_BUFFER|u_doubleBuffer)|(?P<single>BUFFER|u_buffer))_?(?P<number>\d)\b")
_MARK = re.compile(r"\b(?:DOUBLE_BUFFER_\d|u_doubleBuffer\d|BUFFER_\d|u_buffer\d)\b")


def holds(files: Sequence[Given]) -> bool:
    """The names of its buffers, as macros or samplers."""
    return len(files) == 1 and _MARK.search(files[0].bare) is not None


def read(files: Sequence[Given], answers: Answers) -> Contract:
    """The passes of one file: its buffers, its double buffers, and the picture that shows them."""
    file = files[0]
    buffers = sorted({("DOUBLE_BUFFER" if found["double"] else "BUFFER") + "_" + found["number"]
                      for found in _BUFFER.finditer(file.bare)})
    drawn = [name for name in buffers if re.search(rf"\b{name}\b", file.bare)]
    version, note = said_version(joined([replace(file.piece, folder=None, text=_without_includes(file.bare))]))
    answers.note(note)
    language = version or Language(OLDEST)
    passes = []
    for name in [*drawn, "image"]:
        defines = {name: ""} if name != "image" else {}
        source = joined([file.piece], {**language.macros, **defines})
        found = declarations(source, {**language.macros, **defines})
        if name == "image" and not found.functions.get("main") and drawn:
            break  # nothing shows them
        entry(source, found)
        reads = [buffer for buffer in drawn if _sampler(buffer) in _used(source.text, {**language.macros, **defines})]
        channels = {_sampler(buffer): Channel(_sampler(buffer), "self" if buffer == name else f"pass:{buffer}",
                                              linear=True) for buffer in buffers}
        for buffer in buffers:
            if buffer not in drawn:
                channels[_sampler(buffer)] = Channel(_sampler(buffer), "black")
        frame = Frame(language, _ROLES, channels, defines=defines, zero=language.es,
                      displays=name == "image" and bool(reads))
        passes.append(make_pass(name, source, frame, answers))
    if not passes:
        raise ShaderError(f"{file.name}:1: none of its passes has a main(); write one within '#ifdef DOUBLE_BUFFER_0'")
    return make_contract("glslviewer", passes, answers)


def _sampler(buffer: str) -> str:
    return ("u_doubleBuffer" if buffer.startswith("DOUBLE") else "u_buffer") + buffer[-1]


def _used(text: str, macros: dict[str, str]) -> set[str]:
    return set(re.findall(r"\bu_\w+", re.sub(r"\buniform\b[^;]*;", "", preprocess(text, macros).text)))


def _without_includes(text: str) -> str:
    return re.sub(r"^[ \t]*#[ \t]*include\b[^\n]*", "", text, flags=re.MULTILINE)


DIALECT = Dialect("glslviewer", "a file for glslViewer", holds, read)
