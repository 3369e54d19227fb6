"""The course's own contract, read as a stranger's: samples that are numbered (see native.py, which runs it)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from harness.shader.contract import Channel, Contract, ShaderPass
from harness.shader.declarations import declarations, entry
from harness.shader.hosts.reading import Answers, Dialect, Frame, Given, make_contract, make_pass
from harness.shader.includes import joined
from harness.shader.language import GRATIN, said_version

_MARKS = ("pingpong0", "numpass", "samples_per_pass", "first_sample")
_SAMPLES = re.compile(r"\buniform\s+int\s+samples_per_pass\s*=\s*(\d+)")


def holds(files: Sequence[Given]) -> bool:
    """The uniforms by which samples are numbered, declared in one of the files."""
    return sum(_sums(file) for file in files) == 1


def read(files: Sequence[Given], answers: Answers) -> Contract:
    """The file that sums, which holds all that it needs or includes it from its folder, and files that show the sum."""
    first, *shows = sorted(files, key=lambda file: not _sums(file))
    passes = [_pass(first, {"pingpong0": "self"}, answers)]
    for file in shows:
        samplers = [one.name for one in declarations(joined([file.piece], GRATIN.macros), GRATIN.macros).uniforms
                    if one.kind == "sampler2D"]
        passes.append(_pass(file, dict.fromkeys(samplers, f"pass:{first.path.stem}"), answers, displays=True))
    samples = _SAMPLES.search(passes[0].source.text)
    said = answers.kept.get("samples_per_pass")
    count = said if isinstance(said, int) else int(samples[1]) if samples else 1
    return make_contract("native", passes, answers, samples=count)


def _sums(file: Given) -> bool:
    return all(re.search(rf"\buniform\b[^;]*\b{mark}\b", file.bare) for mark in _MARKS)


def _pass(file: Given, reads: Mapping[str, str], answers: Answers, displays: bool = False) -> ShaderPass:
    source = joined([file.piece], GRATIN.macros)
    entry(source, declarations(source, GRATIN.macros))
    version, note = said_version(source)
    answers.note(note)
    channels = {name: Channel(name, what) for name, what in reads.items()}
    frame = Frame(version or GRATIN, {"numpass": "frame"}, channels, displays=displays)
    return make_pass(file.path.stem, source, frame, answers)


DIALECT = Dialect("native", "our own contract, with samples that are numbered", holds, read)
