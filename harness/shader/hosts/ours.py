"""The course's own contract, read as a stranger's: samples that are numbered (see native.py, which runs it)."""

from __future__ import annotations

import re
from collections.abc import Sequence

from harness.shader.contract import Channel, Contract
from harness.shader.declarations import declarations, entry
from harness.shader.hosts.reading import Answers, Dialect, Frame, Given, make_contract, make_pass
from harness.shader.includes import joined
from harness.shader.language import GRATIN, said_version

_MARKS = ("pingpong0", "numpass", "samples_per_pass", "first_sample")
_SAMPLES = re.compile(r"\buniform\s+int\s+samples_per_pass\s*=\s*(\d+)")


def holds(files: Sequence[Given]) -> bool:
    """The uniforms by which samples are numbered, declared."""
    return len(files) == 1 and all(re.search(rf"\buniform\b[^;]*\b{mark}\b", files[0].bare) for mark in _MARKS)


def read(files: Sequence[Given], answers: Answers) -> Contract:
    """One file that holds all that it needs, or includes it from its folder."""
    source = joined([files[0].piece], GRATIN.macros)
    entry(source, declarations(source, GRATIN.macros))
    version, note = said_version(source)
    answers.note(note)
    frame = Frame(version or GRATIN, {"numpass": "frame"}, {"pingpong0": Channel("pingpong0", "self")})
    made = make_pass(files[0].path.stem, source, frame, answers)
    samples = _SAMPLES.search(source.text)
    said = answers.kept.get("samples_per_pass")
    count = said if isinstance(said, int) else int(samples[1]) if samples else 1
    return make_contract("native", [made], answers, samples=count)


DIALECT = Dialect("native", "our own contract, with samples that are numbered", holds, read)
