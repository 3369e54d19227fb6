"""Library functions exchanged for others of the same name: the handout's formulas, or anybody's own, in our tracer."""

from __future__ import annotations

import re
from pathlib import Path

from harness.errors import ShaderError

# A function as the library writes it: its signature, a brace on a line of its own, and one in column 0 at the end.
_FUNCTION = re.compile(r"^\w+ (?P<name>\w+)\([^;{}]*\)\n\{\n.*?^\}\n", re.MULTILINE | re.DOTALL)


def override(root: Path, *chunks: str) -> dict[str, str]:
    """The library files of `root`/lib whose functions `chunks` define anew, for `assemble(generated=…)`.

    `chunks`: file names under `root`. Each function of the library that a chunk defines too is blanked out, so that
    the lines of the rest keep their numbers, and the last of them gives way to an include of the chunk: whatever the
    compiler has to say is said of the chunk's own file and line.

    Raises ShaderError for a chunk that does not exist, shares no function with the library, or shares functions with
    two of its files.
    """
    library = {f"lib/{path.name}": path.read_text(encoding="utf-8") for path in sorted((root / "lib").glob("*.glsl"))}
    changed: dict[str, str] = {}
    for chunk in chunks:
        try:
            names = set(_functions((root / chunk).read_text(encoding="utf-8")))
        except OSError:
            raise ShaderError(f'no such shader file "{chunk}"; looked up in {root}') from None
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
