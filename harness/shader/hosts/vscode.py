"""VS Code's shader-toy extension: a Shadertoy in one file, wired by directives (`#iChannel0 "self"`)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from harness.errors import ShaderError
from harness.shader.contract import Channel, Contract
from harness.shader.decoding import decoded
from harness.shader.hosts.reading import Answers, Dialect, Given
from harness.shader.hosts.shadertoy import UNIFORMS, Tab, contract_of
from harness.shader.lexer import hidden

# `#iChannel0 "self"`, `#iChannel1 "file://noise.png"`, `#iChannel0::MinFilter "Linear"`, `#iKeyboard`, `#iUniform …`.
_DIRECTIVE = re.compile(r"^[ \t]*#[ \t]*(?P<word>iChannel\d|iKeyboard|iUniform|iVertex)(?:::(?P<part>\w+))?[ \t]*"
                        r"(?P<rest>[^\n]*)", re.MULTILINE)
_UNIFORM = re.compile(r"(?P<kind>\w+)\s+(?P<name>\w+)\s*(?:=\s*(?P<value>.+?))?\s*(?:\bin\s*\{.*\}.*)?(?:step.*)?$")
_MAX_PASSES = 8


def holds(files: Sequence[Given]) -> bool:
    """Its directives, or Shadertoy's uniforms in a file with `main`, without a version, that declares none of them."""
    text = "\n".join(file.bare for file in files)
    if re.search(r"^[ \t]*#[ \t]*(?:iChannel\d|iKeyboard|iUniform)", text, re.MULTILINE):
        return True
    used = [name for name in UNIFORMS if re.search(rf"\b{name}\b", text)]
    return bool(used) and not re.search(r"^[ \t]*#[ \t]*version", text, re.MULTILINE) and not any(
        re.search(rf"\buniform\b[^;]*\b{name}\b", text) for name in used) and bool(
        re.search(r"\bvoid\s+main\s*\(", text))


def read(files: Sequence[Given], answers: Answers) -> Contract:
    """The named file and those that its channels name."""
    if len(files) > 1:
        raise ShaderError(f"{files[1].name}: name the last file of the chain only; its #iChannel directives name the "
                          "others")
    first = files[0]
    tabs: dict[Path, Tab] = {}
    _follow(first, tabs, answers, "Image")
    order = list(tabs.values())
    if len(order) == 1:
        order[0].name = first.path.stem
    return contract_of(order, answers, "vscode")


def _follow(file: Given, tabs: dict[Path, Tab], answers: Answers, name: str) -> None:
    """Add the passes that a file reads, then itself."""
    mine = file.path.resolve()
    tab = Tab(name, [])
    channels: dict[str, Channel] = {}
    placeholders = {mine: tab}
    parts, done = [], 0
    for found in _DIRECTIVE.finditer(file.bare):
        word, part, rest = found["word"], found["part"], found["rest"].strip()
        where = f"{file.name}:{file.bare.count(chr(10), 0, found.start()) + 1}"
        replacement = hidden(found[0])
        if word == "iUniform":
            replacement = _uniform(rest, where, answers)
        elif word == "iKeyboard":
            answers.note(f"{where}: the keyboard is not there; no key is pressed")
        elif part and word in channels:
            setting = rest.strip('"').lower()
            channels[word] = replace(channels[word], linear=channels[word].linear or "linear" in setting,
                                     repeat=channels[word].repeat or setting == "repeat")
        elif not part and word.startswith("iChannel"):
            channels[word] = _channel(word, rest.strip().strip('"'), where, file, tabs, answers, placeholders)
        parts += [file.bare[done:found.start()], replacement]
        done = found.end()
    tab.channels = channels
    tab.pieces = [replace(file.piece, text="".join([*parts, file.bare[done:]]), shown=file.text)]
    tabs[mine] = tab


def _channel(name: str, what: str, where: str, file: Given, tabs: dict[Path, Tab], answers: Answers,
             open_now: dict[Path, Tab]) -> Channel:
    """What a channel's directive names."""
    if what == "self":
        return Channel(name, "self")
    if what.startswith(("http:", "https:")) or not what:
        answers.note(f"{where}: {name} reads something of the web; a stand-in, noise, takes its place")
        return Channel(name, "noise", repeat=True)
    folder = file.path.parent
    target = (folder / what.removeprefix("file://")).resolve()
    if not target.is_relative_to(folder.resolve()):
        raise ShaderError(f'{where}: {name} reads "{what}", which leads out of the folder of the shader; copy the file '
                          "into that folder")
    if target.suffix.lower() not in (".glsl", ".frag", ".fs"):
        return Channel(name, f"file:{target}" if target.is_file() else "noise", linear=True, repeat=True)
    if target in open_now or target == file.path.resolve():
        return Channel(name, "self")
    if target not in tabs:
        if len(tabs) >= _MAX_PASSES:
            raise ShaderError(f"{where}: more than {_MAX_PASSES} passes that read each other in a row")
        read_text = decoded(target)
        answers.note(read_text.note)
        _follow(Given(target if folder.is_absolute() else folder / what.removeprefix("file://"), read_text.text), tabs,
                answers, target.stem)
    return Channel(name, f"pass:{tabs[target].name}")


def _uniform(rest: str, where: str, answers: Answers) -> str:
    """`#iUniform float x = 1.0 in {0.0, 2.0}` as a declaration in the same line; its default is kept as its value.

    A default that is no number stays in the text, and cannot be set.
    """
    found = _UNIFORM.match(rest)
    if not found:
        raise ShaderError(f"{where}: '#iUniform {rest}'; write '#iUniform float name = 1.0 in {{0.0, 2.0}}'")
    kind = {"color3": "vec3", "color4": "vec4"}.get(found["kind"], found["kind"])
    if not found["value"]:
        return f"uniform {kind} {found['name']};"
    value = found["value"].split(" in ")[0].strip()
    inside = re.fullmatch(r"(?:(?:color|[iu]?vec)[234]\s*\()?([-+.,\d\seE]+)\)?", value)
    try:
        numbers = tuple(float(part) for part in inside[1].split(",")) if inside else ()
    except ValueError:
        numbers = ()
    if len(numbers) == (int(kind[-1]) if kind[-1] in "234" else 1):
        if found["name"] not in answers.values:
            answers.kept[found["name"]] = (numbers if len(numbers) > 1 else int(numbers[0]) if kind in ("int", "uint")
                                           else numbers[0])
        return f"uniform {kind} {found['name']};"
    value = re.sub(r"color([34])", r"vec\1", value)
    return f"const {kind} {found['name']} = {value};"


DIALECT = Dialect("vscode", "a file for VS Code's shader-toy extension", holds, read)
