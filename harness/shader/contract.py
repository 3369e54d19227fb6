"""What somebody's shader is to a host that runs it: its passes, what their samplers and uniforms stand for, and how
each frame is joined to its past.

A host (harness/shader/hosts) reads files into a `Contract`; experiments (harness/strangers) find out what no text tells
for certain, and complete it. It is data: `contract.toml` holds the same and may be edited.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from harness.shader.source import ShaderSource

# What a uniform is for. frame: its number from `first_frame` on; count: how many frames there will be with this one;
# past_weight, new_weight: n / (n + 1) and 1 / (n + 1) where n frames are in the past; random: from the host, new in
# each frame; time, time_delta, date: seconds, as a steady clock of 60 frames a second has them.
Role = Literal["frame", "count", "time", "time_delta", "frame_rate", "date", "resolution", "width", "height", "aspect",
               "past_weight", "new_weight", "mouse", "random"]
# A uniform's value: a number or a truth value, or several of a vector or an array.
Value = float | int | bool | tuple[float, ...]


@dataclass(frozen=True)
class Channel:
    """A sampler, and what it reads.

    `reads`: `self` (what this pass left in the last frame), `pass:NAME` (what another pass left), `file:PATH`, or a
    stand-in: `keyboard` (no key is pressed), `noise`, `black`, `white`, `cube`, `volume`. `kind`: its GLSL type.
    """

    name: str
    reads: str
    kind: str = "sampler2D"
    linear: bool = False
    repeat: bool = False


@dataclass(frozen=True)
class Declared:
    """A uniform that a pass declares: `kind` is its GLSL type, `size` above 0 where it is an array; `where`: file and
    line; `initialised`: it has a value of its own."""

    name: str
    kind: str
    where: str
    size: int = 0
    initialised: bool = False


@dataclass(frozen=True)
class ShaderPass:
    """One draw of a frame.

    `source`: fragment shader, complete, as a desktop driver takes it, with the author's line numbers; `vertex`: the
    vertex shader to it, whose only attribute is the corners (-1, -1), (3, -1) and (-1, 3) of one triangle. `roles`:
    what uniforms are for, by their names. `displays`: it shows what others have summed, and nobody reads what it draws.
    """

    name: str
    source: ShaderSource
    vertex: str
    channels: tuple[Channel, ...] = ()
    uniforms: tuple[Declared, ...] = ()
    roles: tuple[tuple[str, Role], ...] = ()
    displays: bool = False


@dataclass(frozen=True)
class Law:
    """How a frame is joined to its past: out = a(n) past + b(n) sample, where n frames are in the past.

    `kind`: sum (a = 1); mean (a = (n + offset) / (n + offset + 1)); blend (a is always `weight`); none (the past is not
    used); other. `encoding`: of what is kept, x^(1/2.2), x^(1/2), sRGB, or nothing. `count`: where the number of frames
    in the past stands: the frame's number (or what follows from it), the host's uniform, alpha, 1 / alpha.
    `measured`: (n, a) as they were found.
    """

    kind: Literal["sum", "mean", "blend", "none", "other"]
    offset: int = 0
    weight: float = 0.0
    encoding: Literal["", "gamma", "sqrt", "srgb"] = ""
    count: Literal["frame", "uniform", "alpha", "inverse_alpha"] = "frame"
    measured: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True)
class Contract:
    """All that a host must know of a shader to run it, and a judge to take its frames as samples.

    `host`: the dialect's name. `radiance`: the pass whose output holds radiance. `values`: uniforms that somebody gave
    a value, by name. `law`: None until it was measured. `samples`: of one frame, where they are known. `size`: (width,
    height) where the author has written one in. `unknown`: uniforms whose use nobody knows: they must be given by name.
    `flipped`: row 0 of what it draws is the top one (else the bottom one, as GL has it). `notes`: what stands in for
    what is not there, and what was changed in the text. `said`: what a human said, as it was said.
    """

    host: str
    passes: tuple[ShaderPass, ...]
    radiance: str
    values: tuple[tuple[str, Value], ...] = ()
    first_frame: int = 0
    law: Law | None = None
    samples: int = 1
    size: tuple[int, int] | None = None
    unknown: tuple[Declared, ...] = ()
    flipped: bool = False
    notes: tuple[str, ...] = ()
    said: tuple[str, ...] = ()
