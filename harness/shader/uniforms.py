"""What a shader's text says of its uniforms: where each is declared, and whether with a value of its own."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from harness.shader.source import ShaderSource

_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
# `layout(binding = 1) uniform highp float a = 2.0, b[3];`, or a block `uniform Name { … } instance;`, `buffer` too.
_DECLARATION = re.compile(r"\b(?:uniform|buffer)\b[^;{}]*(?:\{[^}]*\}[^;{}]*)?;")
# Arguments and sizes, which hold commas too.
_NESTED = re.compile(r"\([^()]*\)|\[[^][]*\]|\{[^{}]*\}")


@dataclass(frozen=True)
class Uniform:
    """A declaration: `where` is 'file:line'; `initialised`: it gives a value, which counts where nobody sets one."""

    where: str
    initialised: bool


def uniforms(source: ShaderSource) -> dict[str, Uniform]:
    """The uniforms and blocks that the files of a shader declare, by name; the first declaration of each counts, unless
    a later one (of another branch of the preprocessor) gives a value. What macros write is not found."""
    found: dict[str, Uniform] = {}
    for file, text in source.files:
        bare = _COMMENT.sub(lambda comment: re.sub(r"[^\n]", " ", comment[0]), text)
        for declaration in _DECLARATION.finditer(bare):
            where = f"{file}:{bare.count(chr(10), 0, declaration.start()) + 1}"
            for name, initialised in _names(declaration[0]):
                if name not in found or initialised:
                    found[name] = Uniform(where, initialised)
    return found


def _names(declaration: str) -> Iterator[tuple[str, bool]]:
    """The names that one declaration gives, each with whether it has a value."""
    before, brace, after = declaration.rstrip(";").partition("{")
    if brace and "=" not in before:  # a structure is known by its variable, a block by its own name
        yield (after if "struct" in before.split() else before).split()[-1], False
        return
    flat = declaration.rstrip(";")
    while (bare := _NESTED.sub(" ", flat)) != flat:
        flat = bare
    for declarator in flat.split(","):
        name, initialiser, _ = declarator.partition("=")
        if words := name.split():
            yield words[-1], bool(initialiser)
