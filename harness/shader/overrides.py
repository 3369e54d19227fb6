"""Library functions exchanged for others of the same name: the handout's formulas, or anybody's own, in our tracer."""

from __future__ import annotations

import re
from collections.abc import Mapping

from harness.errors import ShaderError

# A function as the library writes it: its signature, a brace on a line of its own, and one in column 0 at the end.
_FUNCTION = re.compile(r"^\w+ (?P<name>\w+)\([^;{}]*\)\n\{\n.*?^\}\n", re.MULTILINE | re.DOTALL)


def override(texts: Mapping[str, str], *chunks: str) -> dict[str, str]:
    """The files of lib/ whose functions `chunks` define anew, for `assemble(generated=…)`.

    `texts`: every shader file by name; `chunks`: names among them. Each function of the library that a chunk defines
    too is blanked out, so that the lines of the rest keep their numbers, and the last of them gives way to an include
    of the chunk: whatever the compiler has to say is said of the chunk's own file and line.

    Raises ShaderError for a chunk that does not exist, shares no function with the library, or shares functions with
    two of its files.
    """
    library = {name: text for name, text in sorted(texts.items()) if name.startswith("lib/")}
    changed: dict[str, str] = {}
    for chunk in chunks:
        if chunk not in texts:
            raise ShaderError(f'no such shader file "{chunk}"; name one of the shader folder')
        names = set(_functions(texts[chunk]))
        homes = [file for file, text in library.items() if names & set(_functions(text))]
        if len(homes) != 1:
            where = f"those of {' and '.join(homes)}" if homes else "none of the library's"
            raise ShaderError(f"{chunk}: its functions ({', '.join(sorted(names))}) replace {where}; "
                              "they must replace functions of exactly one file of lib/")
        changed[homes[0]] = _without(changed.get(homes[0], library[homes[0]]), names, chunk)
    return changed


def _functions(text: str) -> list[str]:
    return [found["name"] for found in _FUNCTION.finditer(text)]


def _without(text: str, names: set[str], chunk: str) -> str:
    """`text` with blank lines for the functions in `names`, and an include of `chunk` in the first line of the last."""
    found = [match for match in _FUNCTION.finditer(text) if match["name"] in names]
    for match in reversed(found):
        blank = "\n" * match[0].count("\n")
        include = f'#include "{chunk}"' if match is found[-1] else ""
        text = text[:match.start()] + include + blank + text[match.end():]
    return text
