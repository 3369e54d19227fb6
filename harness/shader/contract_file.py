"""contract.toml: what is known of somebody's shader, written for a human to read and to change, and read back."""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

from harness.errors import HarnessError
from harness.shader.contract import Contract, Law, Role, ShaderPass, Value
from harness.shader.hosts import read
from harness.shader.hosts.reading import Answer

# Each key, what its value must be, and what it is for: the comment above it.
_TOP: Mapping[str, tuple[type, str]] = {
    "host": (str, "The dialect of the files."),
    "radiance": (str, "The pass whose output holds radiance: its name below."),
    "first_frame": (int, "The number that the host gives to the first frame, 0 or 1."),
    "samples": (int, "Samples per pixel in one frame."),
    "flipped": (bool, "true: row 0 of what it draws is the top one; false: the bottom one, as OpenGL has it."),
    "size": (list, "[width, height] where the author has written them into the shader. Leave it out where not."),
    "said": (list, "What a human said with --set NAME=VALUE, as it was said."),
    "notes": (list, "What stands in for what is not there, and what was changed in the text."),
}
_LAW: Mapping[str, tuple[type, str]] = {
    "kind": (str, "sum: out = past + sample. mean: out = past (n + offset) / (n + offset + 1) + …, n frames in the "
                  "past. blend: the past's weight is always `weight`. none: the past is not used. other."),
    "offset": (int, "Of a mean: how many frames more it believes to be in the past."),
    "weight": (float, "Of a blend: the weight of the past."),
    "encoding": (str, "How the past is kept: \"\" as it is, \"gamma\" x^(1/2.2), \"sqrt\", \"srgb\"."),
    "count": (str, "Where the number of frames in the past stands: frame, uniform, alpha, inverse_alpha."),
    "measured": (list, "[n, weight of the past where n frames are in it] as they were found."),
}
_CHANNEL: Mapping[str, type] = {"name": str, "reads": str, "kind": str, "linear": bool, "repeat": bool}
_PASS: Mapping[str, type] = {"name": str, "displays": bool, "roles": dict, "channel": list}
_CHOICES: Mapping[str, tuple[str, ...]] = {
    "kind": ("sum", "mean", "blend", "none", "other"), "encoding": ("", "gamma", "sqrt", "srgb"),
    "count": ("frame", "uniform", "alpha", "inverse_alpha")}
_HEAD = """# What is known of a shader: what its uniforms and samplers stand for, and how a frame is joined to its past.
# It may be edited: the shader is then run and judged as it says here.
"""


def save(contract: Contract, path: Path) -> None:
    """Write a contract. The shader's text is not in it: `load` takes the author's files again.

    HarnessError where the file cannot be written.
    """
    lines = [_HEAD]
    for key, (_, comment) in _TOP.items():
        value = getattr(contract, key)
        if value is not None:
            lines += [f"# {comment}", f"{key} = {_toml(value)}"]
    lines += ["# Of the shader's files as they were when this was found out; without it no change of them is noticed.",
              f"digest = {_toml(digest(contract))}"]
    if contract.law:
        lines += ["", "[law]  # out = a(n) past + b(n) sample; found by experiment"]
        for key, (_, comment) in _LAW.items():
            lines += [f"# {comment}", f"{key} = {_toml(getattr(contract.law, key))}"]
    lines += ["", "# Values of uniforms: NAME = 1.0, or [1.0, 2.0, 3.0] for a vector.", "[values]",
              *(f"{_key(name)} = {_toml(value)}" for name, value in contract.values)]
    if contract.unknown:
        lines += ["# Nobody knows what these are for: give each a value here, or a role in its pass.",
                  *(f"# {_key(one.name)} = …  # {one.kind}, {_one_line(one.where)}" for one in contract.unknown)]
    for one in contract.passes:
        lines += ["", "# A draw of each frame. displays: it shows what others have summed.", "[[pass]]",
                  f"name = {_toml(one.name)}", f"displays = {_toml(one.displays)}",
                  f"# What its uniforms are for: {', '.join(get_args(Role))}.", "[pass.roles]",
                  *(f"{_key(name)} = {_toml(role)}" for name, role in one.roles)]
        for channel in one.channels:
            lines += ["# reads: self (its own last frame), pass:NAME, file:PATH, keyboard, noise, black, white, cube, "
                      "volume.", "[[pass.channel]]",
                      *(f"{key} = {_toml(getattr(channel, key))}" for key in _CHANNEL)]
    try:
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise HarnessError(f"{path}: cannot be written ({error.strerror}); name another file") from None


def load(path: Path, files: Sequence[Path]) -> Contract:
    """The contract of the shader in `files`, as the file says.

    Raises HarnessError, with file and line, for what it may not hold and for passes, uniforms and samplers that the
    shader does not have; ShaderError where the shader cannot be read.
    """
    return _Loader(path).contract(files)


def digest(contract: Contract) -> str:
    """16 hexadecimal digits of the author's texts, whatever the files are called and ends of lines are."""
    texts = sorted({"\n".join(text.splitlines()) for one in contract.passes for _, text in one.source.files})
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:16]


def stale(path: Path, contract: Contract) -> str:
    """A sentence where the shader of a contract that `load` has read is another than the file was written for; else
    empty."""
    kept = tomllib.loads(path.read_text(encoding="utf-8")).get("digest", "")
    if not kept or kept == digest(contract):
        return ""
    return (f"{path}: the shader has changed since this was found out (digest {kept}, now {digest(contract)}); where "
            "its passes, uniforms or averaging changed too, write it anew with --keep-contract")


class _Loader:
    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._text = path.read_text(encoding="utf-8")
            self._data: dict[str, Any] = tomllib.loads(self._text)
        except OSError as error:
            raise HarnessError(f"{path}: cannot be read ({error.strerror}); name a contract.toml") from None
        except UnicodeDecodeError:
            raise HarnessError(f"{path}: not UTF-8 text; save the file as UTF-8") from None
        except tomllib.TOMLDecodeError as error:
            line = re.search(r"line (\d+)", str(error))
            at = line[1] if line else self._text.count("\n")
            raise HarnessError(f"{path}:{at}: not TOML ({error}); compare with a contract that `harness check` "
                               "wrote") from None

    def contract(self, files: Sequence[Path]) -> Contract:
        data = self._data
        self._table(data, {**{key: kind for key, (kind, _) in _TOP.items()},
                           "digest": str, "law": dict, "values": dict, "pass": list})
        said = self._said(data.get("said", []))
        values = {name: self._value(name, value) for name, value in data.get("values", {}).items()}
        found = read(files, data.get("host"), {**said, **values})
        passes = self._passes(found, data.get("pass", []))
        known = {name for one in passes for name, _ in one.roles} | set(values) | {
            channel.name for one in passes for channel in one.channels if channel.reads != "black"}
        radiance = data.get("radiance", found.radiance)
        if radiance not in {one.name for one in passes}:
            self._fail("radiance", f"no pass '{radiance}'; there are {', '.join(one.name for one in passes)}")
        return replace(found, passes=passes, radiance=radiance, values=tuple(sorted(values.items())),
                       first_frame=data.get("first_frame", 0), samples=data.get("samples", 1),
                       flipped=data.get("flipped", False), size=self._size(), law=self._law(),
                       unknown=tuple(one for one in found.unknown if one.name not in known),
                       notes=tuple(str(note) for note in data.get("notes", [])),
                       said=tuple(str(one) for one in data.get("said", [])))

    def _fail(self, key: str, what: str, after: int = 0) -> None:
        """HarnessError at the line of a key, the first from line `after` on."""
        pattern = re.compile(rf"^\s*(?:\[+\s*)?(?:\w+\.)?\"?{re.escape(key)}\"?\s*(?:=|\])")
        lines = self._text.splitlines()
        found = next((number for number, line in enumerate(lines, 1) if number >= after and pattern.match(line)),
                     after or 1)
        raise HarnessError(f"{self._path}:{found}: {key}: {what}")

    def _table(self, table: Mapping[str, Any], kinds: Mapping[str, type], after: int = 0) -> None:
        for key, value in table.items():
            if key not in kinds:
                self._fail(key, f"no such key; there are {', '.join(kinds)}", after)
            kind = kinds[key]
            fits = isinstance(value, (int, float) if kind is float else kind) and (
                kind is bool or not isinstance(value, bool))
            if not fits:
                self._fail(key, f"expected {_KIND_WORDS[kind]}, found {value!r}", after)

    def _size(self) -> tuple[int, int] | None:
        size = self._data.get("size")
        if size is None:
            return None
        if len(size) != 2 or not all(isinstance(side, int) and 0 < side <= 16384 for side in size):
            self._fail("size", f"expected [width, height] in pixels, found {size}")
        return int(size[0]), int(size[1])

    def _law(self) -> Law | None:
        table = self._data.get("law")
        if table is None:
            return None
        line = self._header("[law]")
        self._table(table, {key: kind for key, (kind, _) in _LAW.items()}, line)
        for key, choices in _CHOICES.items():
            if key in table and table[key] not in choices:
                allowed = ", ".join(repr(choice) for choice in choices)
                self._fail(key, f"expected one of {allowed}, found {table[key]!r}", line)
        if "kind" not in table:
            self._fail("law", "it has no kind; write kind = \"sum\" or \"mean\"", line)
        measured = table.get("measured", [])
        if not all(isinstance(pair, list) and len(pair) == 2 and all(isinstance(one, int | float) for one in pair)
                   for pair in measured):
            self._fail("measured", "expected pairs [n, weight]", line)
        return Law(**{**table, "weight": float(table.get("weight", 0.0)),
                      "measured": tuple((int(n), float(a)) for n, a in measured)})

    def _header(self, header: str, number: int = 0) -> int:
        """The line of the `number`th header of this text."""
        found = [at for at, line in enumerate(self._text.splitlines(), 1) if line.replace(" ", "").startswith(header)]
        return found[number] if number < len(found) else 1

    def _said(self, said: Sequence[Any]) -> dict[str, Answer]:
        answers: dict[str, Answer] = {}
        for one in said:
            name, equals, value = str(one).partition("=")
            if not equals:
                self._fail("said", f"expected NAME=VALUE, found {one!r}")
            answers[name.strip()] = answer(value)
        return answers

    def _value(self, name: str, value: Any) -> Value:
        if isinstance(value, list) and value and all(isinstance(part, int | float) for part in value):
            return tuple(float(part) for part in value)
        if not isinstance(value, bool | int | float):
            self._fail(name, f"expected a number, true, false or an array of numbers, found {value!r}",
                       self._header("[values]"))
        result: Value = value
        return result

    def _passes(self, found: Contract, tables: Sequence[Any]) -> tuple[ShaderPass, ...]:
        given: dict[str, tuple[int, dict[str, Any]]] = {}
        names = [one.name for one in found.passes]
        for number, table in enumerate(tables):
            line = self._header("[[pass]]", number)
            self._table(table, _PASS, line)
            if table.get("name") not in names:
                self._fail("name", f"the shader has no pass {table.get('name')!r}; it has {', '.join(names)}", line)
            given[table["name"]] = line, table
        return tuple(self._pass(one, *given[one.name]) if one.name in given else one for one in found.passes)

    def _pass(self, one: ShaderPass, line: int, table: Mapping[str, Any]) -> ShaderPass:
        declared = {uniform.name for uniform in one.uniforms}
        roles = table.get("roles")
        for name, role in (roles or {}).items():
            if name not in declared:
                self._fail(name, f"the pass declares no such uniform; it declares {', '.join(sorted(declared))}", line)
            if role not in get_args(Role):
                self._fail(name, f"no such role, {role!r}; there are {', '.join(get_args(Role))}", line)
        channels = {channel.name: channel for channel in one.channels}
        for entry in table.get("channel", []):
            self._table(entry, _CHANNEL, line)
            if entry.get("name") not in channels:
                self._fail("name", f"the pass has no sampler {entry.get('name')!r}; it has {', '.join(channels)}", line)
            channels[entry["name"]] = replace(channels[entry["name"]], **entry)
        return replace(one, displays=table.get("displays", one.displays), channels=tuple(channels.values()),
                       roles=one.roles if roles is None else tuple(roles.items()))


_KIND_WORDS = {str: "a text in quotes", int: "a whole number", float: "a number", bool: "true or false",
               list: "an array", dict: "a table"}


def answer(text: str) -> Answer:
    """What `--set NAME=VALUE` says: a number, true or false, numbers with commas between them; else a word."""
    parts = [part.strip() for part in text.split(",")]
    if text.strip() in ("true", "false"):
        return text.strip() == "true"
    try:
        if len(parts) > 1:
            return tuple(float(part) for part in parts)
        return int(parts[0]) if re.fullmatch(r"[-+]?\d+", parts[0]) else float(parts[0])
    except ValueError:
        return text.strip()


def _key(name: str) -> str:
    return name if re.fullmatch(r"[\w-]+", name) else _toml(name)


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, tuple | list):
        return f"[{', '.join(_toml(part) for part in value)}]"
    return repr(value)


__all__ = ["answer", "load", "save", "stale"]
