"""What every dialect's reading is made of: the files that were named, what somebody said of them, and one pass."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import get_args

from harness.errors import ShaderError
from harness.shader.contract import Channel, Contract, Declared, Role, ShaderPass, Value
from harness.shader.declarations import Declarations, declarations
from harness.shader.hosts.roles import channel_of, role_of
from harness.shader.hosts.vertex import RANGES, authors, synthesised
from harness.shader.hosts.written import written_samples
from harness.shader.includes import Piece
from harness.shader.language import Language, complete
from harness.shader.lexer import without_comments
from harness.shader.source import ShaderSource

ROLES: tuple[str, ...] = get_args(Role)
STAND_INS = ("self", "keyboard", "noise", "black", "white", "cube", "volume")
# Pages, scripts, and C++, which holds shaders in raw strings.
PAGES = (".html", ".htm", ".vue", ".svelte")
SCRIPTS = (".js", ".mjs", ".cjs", ".ts", ".jsx", ".tsx", *PAGES)
PROGRAMS = (*SCRIPTS, ".cpp", ".cc", ".cxx", ".hpp", ".h", ".c")
# What somebody may say of a uniform: its value, its role, what a sampler reads, or the range of a varying.
Answer = Value | str


@dataclass(frozen=True)
class Given:
    """A file that was named: its path, its text, and a note where it was not read as UTF-8."""

    path: Path
    text: str
    note: str = ""

    @property
    def name(self) -> str:
        """What messages call it."""
        return str(self.path)

    @property
    def in_program(self) -> bool:
        """Whether it is a page or a program that may hold shaders, and no shader itself."""
        return self.path.suffix.lower() in PROGRAMS

    @cached_property
    def bare(self) -> str:
        """Its text without comments, nothing of a program's. ShaderError as for `without_comments`."""
        return "" if self.in_program else without_comments(self.text, self.name)

    @property
    def piece(self) -> Piece:
        """Its text, which may include others of its folder."""
        return Piece(self.name, self.text, self.path.parent)


@dataclass
class Answers:
    """What was said of a shader, by name, and what of it was of use; `notes` and `unknown` gather what to say of it."""

    values: Mapping[str, Answer]
    used: set[str] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)
    unknown: list[Declared] = field(default_factory=list)
    kept: dict[str, Value] = field(default_factory=dict)

    def take(self, name: str) -> Answer | None:
        """What was said of `name`; it counts as used."""
        if name in self.values:
            self.used.add(name)
        return self.values.get(name)

    def note(self, *notes: str) -> None:
        """Something to say, once."""
        self.notes += [note for note in notes if note and note not in self.notes]


@dataclass(frozen=True)
class Dialect:
    """A row of the table of hosts: its name, what it is, whether files are in it, and how they are read.

    `holds`: by their syntax alone. `read` may raise ShaderError in one line.
    """

    name: str
    about: str
    holds: Callable[[Sequence[Given]], bool]
    read: Callable[[Sequence[Given], Answers], Contract]


@dataclass(frozen=True)
class Frame:
    """What a dialect knows of a pass besides the author's text.

    `known`: uniforms with a role by the host's contract; `channels`: what samplers read; `head`: uniforms that the host
    declares, which the author does not: (type, name). `lines`: more declarations; `after`: text behind the author's.
    `guess`: roles of other uniforms are told by their names. `defines` hold before the text.
    """

    language: Language
    known: Mapping[str, Role] = field(default_factory=dict)
    channels: Mapping[str, Channel] = field(default_factory=dict)
    head: Sequence[tuple[str, str]] = ()
    lines: Sequence[str] = ()
    defines: Mapping[str, str] = field(default_factory=dict)
    after: str = ""
    zero: bool = False
    guess: bool = True
    displays: bool = False
    vertex: Piece | None = None


def make_pass(name: str, source: ShaderSource, frame: Frame, answers: Answers) -> ShaderPass:
    """A pass from a joined text (harness/shader/includes.py).

    ShaderError, with file and line, where it cannot be drawn.
    """
    macros = {**frame.language.macros, **frame.defines}
    found = declarations(source, macros)
    head = [(kind, word) for kind, word in frame.head if word not in found.declared]
    vertex, extra = _vertex(found, frame, answers)
    mine = [Declared(word, kind, f"the head that the host writes ({name})") for kind, word in head]
    uniforms = _unique([*found.uniforms, *mine, *extra])
    roles: list[tuple[str, Role]] = []
    channels: list[Channel] = []
    theirs = {uniform.name for uniform in found.uniforms}
    for uniform in uniforms:
        uses = found.names.get(uniform.name.split(".")[0], 0) - (uniform.name in theirs)
        if "sampler" in uniform.kind:
            channels.append(_channel(uniform, frame, answers, uses > 0))
        elif role := _role(uniform, frame, answers, uses > 0):
            roles.append((uniform.name, role))
    declares = [*(f"uniform {kind} {word};" for kind, word in head), *frame.lines]
    text = complete(source, frame.language, declares, frame.defines, frame.zero, frame.after)
    return ShaderPass(name, text, vertex, tuple(channels), tuple(uniforms), tuple(roles), frame.displays)


def make_contract(host: str, passes: Sequence[ShaderPass], answers: Answers, size: tuple[int, int] | None = None,
                  samples: int = 0) -> Contract:
    """The contract of these passes; radiance is in the last that reads its own past and shows nothing.

    `samples`: of a frame, as that pass's text says it where they are 0.

    ShaderError for an answer that names nothing in the shader, and for a channel that reads a pass that is not there.
    """
    names = [one.name for one in passes]
    declared = sorted({uniform.name for one in passes for uniform in one.uniforms})
    for name in answers.values:
        if name in declared and name not in answers.used:
            raise ShaderError(f"{passes[-1].source.files[-1][0]}: --set {name}: the host feeds that; leave it out")
        if name not in answers.used:
            raise ShaderError(f"{passes[-1].source.files[-1][0]}: --set {name}: the shader declares no uniform of that "
                              f"name; it declares {', '.join(declared) or 'none'}")
    for one in passes:
        for channel in one.channels:
            if channel.reads.startswith("pass:") and channel.reads[5:] not in names:
                raise ShaderError(f"{one.source.files[-1][0]}: '{channel.name}' of {one.name} reads the pass "
                                  f"'{channel.reads[5:]}', which is not there; there are {', '.join(names)}")
    summing = [one.name for one in passes if not one.displays and any(c.reads == "self" for c in one.channels)]
    drawing = [one.name for one in passes if not one.displays] or names
    radiance = (summing or drawing)[-1]
    text = next(one.source.text for one in passes if one.name == radiance)
    return Contract(host, tuple(passes), radiance, tuple(sorted(answers.kept.items())),
                    samples=samples or written_samples(text), size=size,
                    unknown=tuple(_unique(answers.unknown)), notes=tuple(answers.notes),
                    said=tuple(f"{name}={_spelt(value)}" for name, value in sorted(answers.values.items())))


def _spelt(value: Answer) -> str:
    if isinstance(value, tuple):
        return ",".join(f"{part:g}" for part in value)
    return str(value).lower() if isinstance(value, bool) else str(value)


def _unique(uniforms: Iterable[Declared]) -> list[Declared]:
    """The first of each name, but for a later one with a value."""
    found: dict[str, Declared] = {}
    for uniform in uniforms:
        if uniform.name not in found or (uniform.initialised and not found[uniform.name].initialised):
            found[uniform.name] = uniform
    return list(found.values())


def _vertex(found: Declarations, frame: Frame, answers: Answers) -> tuple[str, list[Declared]]:
    """The vertex shader to a pass, and the uniforms that it brings."""
    if frame.vertex is not None:
        own = authors(frame.vertex, frame.language)
        if own is not None:
            return own.text, declarations(own, frame.language.macros, vertex=True).uniforms
        answers.note(f"{frame.vertex.name}: its vertex shader moves a scene's triangles; a triangle over the whole "
                     "image is drawn instead")
    inputs = [varying for varying in found.varyings if found.names.get(varying.name, 0) > 1]
    said = {varying.name: answers.take(varying.name) for varying in inputs if varying.name in answers.values}
    for name, value in said.items():
        if value not in RANGES:
            raise ShaderError(f"--set {name}={value}: '{name}' comes from the vertex shader; say unit (0 to 1) or ndc "
                              "(-1 to 1)")
    text, notes = synthesised(frame.language, inputs, said)
    answers.note(*notes)
    return text, []


def _channel(uniform: Declared, frame: Frame, answers: Answers, in_use: bool) -> Channel:
    """What a sampler reads. One of which nobody knows is black, never the pass's own past, and is asked for."""
    said = answers.take(uniform.name) if uniform.name not in frame.channels else None
    if said is not None:
        return said_channel(uniform.name, said, Channel(uniform.name, "black", uniform.kind), uniform.where)
    known = frame.channels.get(uniform.name) or (channel_of(uniform.kind, uniform.name) if frame.guess else None)
    if known is None or uniform.size:
        if in_use and (frame.guess or uniform.size):
            answers.unknown.append(uniform)
        return Channel(uniform.name, "black", uniform.kind)
    if known.reads in STAND_INS[1:] and known.reads != "black" and in_use:
        answers.note(f"{uniform.where}: '{uniform.name}' reads a stand-in, {known.reads}")
    return known


def said_channel(name: str, said: Answer, before: Channel, where: str) -> Channel:
    """What somebody said that a sampler reads. ShaderError, with file and line, for what it cannot read."""
    reads = str(said)
    if reads not in STAND_INS and not re.match(r"(?:pass|file):.", reads):
        raise ShaderError(f"{where}: --set {name}={reads}: a sampler reads {', '.join(STAND_INS)}, pass:NAME or "
                          "file:PATH")
    return replace(before, reads=reads, kind={"cube": "samplerCube", "volume": "sampler3D"}.get(reads, before.kind))


def _role(uniform: Declared, frame: Frame, answers: Answers, in_use: bool) -> Role | None:
    """What a uniform is for: as somebody said, as the host has it, or as its name tells. Else it is asked for."""
    said = answers.take(uniform.name)
    inside = [name for name in answers.values if name.startswith(f"{uniform.name}[")]
    for name in inside:
        answers.kept[name] = fitting(uniform, name, answers.take(name), part=True)
    if isinstance(said, str):
        if said not in ROLES:
            raise ShaderError(f"{uniform.where}: --set {uniform.name}={said}: neither a value nor what a uniform is "
                              f"for; say a number, or one of {', '.join(ROLES)}")
        return next(role for role in get_args(Role) if role == said)
    if said is not None:
        answers.kept[uniform.name] = fitting(uniform, uniform.name, said)
        return None
    if uniform.name in answers.kept:  # the file says its value
        return None
    role = frame.known.get(uniform.name)
    if role is None and not uniform.initialised and not uniform.size and frame.guess:
        role = role_of(uniform.kind, uniform.name)
    if role is None and in_use and not uniform.initialised and not inside:
        answers.unknown.append(uniform)
    return role


def fitting(uniform: Declared, name: str, said: Answer | None, part: bool = False) -> Value:
    """A value that fits what is declared; `part`: of one of an array. ShaderError, with file and line, for one that
    does not."""
    kind = uniform.kind
    columns = re.fullmatch(r"(?:[iubd]?vec|mat)([234])(?:x([234]))?", kind)
    count = 1 if not columns else int(columns[1]) * (int(columns[2] or columns[1]) if kind.startswith("mat") else 1)
    count *= 1 if part else max(uniform.size, 1)
    numbers = said if isinstance(said, tuple) else (said,)
    if any(isinstance(number, str) or number is None for number in numbers) or len(numbers) != count:
        raise ShaderError(f"{uniform.where}: --set {name}: a {kind}{f'[{uniform.size}]' if uniform.size else ''} has "
                          f"{count} number{'s' if count > 1 else ''}, found {len(numbers)}")
    values = tuple(float(number) for number in numbers if not isinstance(number, str) and number is not None)
    if count > 1:
        return values
    if kind == "bool":
        return bool(values[0])
    if kind not in ("int", "uint"):
        return values[0]
    if values[0] != int(values[0]):
        raise ShaderError(f"{uniform.where}: --set {name}: '{kind} {name}' takes a whole number, found {values[0]:g}")
    return int(values[0])
