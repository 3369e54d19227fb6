"""What an author has given a name in a shader, uniforms, constants and macros, and the shader with other values there.

To a host that runs it such names are what `<default>` parameters are in a scene file: what may be changed in it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from harness.errors import ShaderError
from harness.shader.contract import Contract, Declared, ShaderPass, Value
from harness.shader.declarations import BASIC, declarations
from harness.shader.hosts.reading import fitting
from harness.shader.hosts.written import written_samples
from harness.shader.lexer import place

# An object-like macro whose value begins as a number, a vector or a truth value does.
_MACRO = re.compile(r"^[ \t]*#[ \t]*define[ \t]+(?P<name>[A-Za-z_]\w*)[ \t]+(?P<value>"
                    r"(?=[(+\- \t]*(?:\.?\d|[iu]?vec[234]\b|(?:true|false)\b))[^\n]*?)[ \t\r]*$", re.MULTILINE)
_VECTOR = re.compile(r"\(*\s*([iu]?vec[234])\b")
_WHOLE = re.compile(r"\(*\s*[+-]?\d+[uU]?\s*\)*$")


@dataclass(frozen=True)
class _Written:
    """A value that stands in the text of a pass, from `start` to `end`, as what type, and in which file and line."""

    one: Declared
    start: int
    end: int
    macro: bool = False


def named(contract: Contract) -> tuple[str, ...]:
    """The names that may be given another value: uniforms but samplers, constants outside of functions, and macros that
    are a number, a vector or a truth value; each once, those that the host has a use for last."""
    found: dict[str, None] = {}
    for one in contract.passes:
        found |= dict.fromkeys(uniform.name for uniform in one.uniforms if "sampler" not in uniform.kind)
        found |= dict.fromkeys(written.one.name for written in _written(one))
    hosts = {name for one in contract.passes for name, _ in one.roles}
    return tuple(sorted(found, key=hosts.__contains__))


def with_values(contract: Contract, values: Mapping[str, str]) -> Contract:
    """The contract with these values by name, in every pass that has the name: numbers with spaces between, or true and
    false. A constant or a macro is another text of the same lines.

    ShaderError, with file and line, for a value that does not fit the name's type; names that `named` lacks are left.
    """
    kept, changed = dict(contract.values), contract
    for name, text in values.items():
        passes = []
        for one in changed.passes:
            for uniform in one.uniforms:
                if uniform.name == name and "sampler" not in uniform.kind:
                    kept[name] = fitting(uniform, name, _parsed(uniform, text))
                    one = replace(one, roles=tuple(role for role in one.roles if role[0] != name))
            passes.append(_rewritten(one, name, text))
        changed = replace(changed, passes=tuple(passes),
                          unknown=tuple(each for each in changed.unknown if each.name != name),
                          said=(*changed.said, f"{name}={text}") if name in named(contract) else changed.said)
    return replace(changed, values=tuple(sorted(kept.items())), samples=_samples(contract, changed))


def _samples(before: Contract, after: Contract) -> int:
    """Of one frame: what the text says now, where it was the text that said it."""
    said, says = (next(written_samples(one.source.text) for one in each.passes if one.name == each.radiance)
                  for each in (before, after))
    return says if before.samples == said else before.samples


def _written(one: ShaderPass) -> Iterator[_Written]:
    for constant in declarations(one.source).constants:
        if BASIC.match(constant.one.kind) and not constant.one.size:
            yield _Written(constant.one, constant.start, constant.end)
    for found in _MACRO.finditer(one.source.text):
        value = found["value"]
        if vector := _VECTOR.match(value):
            kind = vector[1]
        else:
            kind = "bool" if value in ("true", "false") else "int" if _WHOLE.match(value) else "float"
        declared = Declared(found["name"], kind, place(one.source, found.start("name")))
        yield _Written(declared, *found.span("value"), macro=True)


def _rewritten(one: ShaderPass, name: str, text: str) -> ShaderPass:
    source = one.source.text
    for found in sorted(_written(one), key=lambda each: -each.start):
        if found.one.name == name:
            said = _parsed(found.one, text)
            kind = found.one
            if found.macro and kind.kind == "int" and isinstance(said, float) and said != int(said):
                kind = replace(kind, kind="float")  # a macro has no type, only a spelling
            # A constant's value may go over several lines, and those after it keep their numbers.
            lines = "\n" * source.count("\n", found.start, found.end)
            source = source[:found.start] + spelt(kind.kind, fitting(kind, name, said)) + lines + source[found.end:]
    return one if source == one.source.text else replace(one, source=replace(one.source, text=source))


def spelt(kind: str, value: Value) -> str:
    """A value as GLSL writes it: `10.0`, `3u`, `vec3(1.0, 0.0, 0.0)`."""
    if isinstance(value, tuple):
        return f"{kind}({', '.join(repr(float(part)) for part in value)})"
    if kind == "bool":
        return "true" if value else "false"
    if kind in ("int", "uint"):
        return f"{value}{'u' if kind == 'uint' else ''}"
    return f"({float(value)!r})" if value < 0 else repr(float(value))


def _parsed(one: Declared, text: str) -> Value:
    """What a scene's parameter says, for a shader. ShaderError for words."""
    if text in ("true", "false"):
        return text == "true"
    try:
        numbers = tuple(float(part) for part in text.replace(",", " ").split())
    except ValueError:
        numbers = ()
    if not numbers:
        raise ShaderError(f"{one.where}: --set {one.name}: a {one.kind} is numbers, found '{text}'; give it numbers "
                          "with spaces between, or call one of the two otherwise, the scene's parameter or this")
    return numbers if len(numbers) > 1 else numbers[0]
