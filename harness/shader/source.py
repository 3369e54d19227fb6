"""GLSL source assembly: #include with numbered #line directives, and compiler messages mapped back to our files."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from harness.errors import ShaderError

# Gratin's version, and old enough for every desktop driver that can run the tracer.
GLSL_VERSION = "#version 420 core"

# Line n of file S is numbered (S + 1) * LINE_STRIDE + n: the line alone tells the file. The source-string number that
# `#line` takes as well is not enough, Mesa 22 reports 0 in its place for an undeclared name.
LINE_STRIDE = 100_000

_INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"\s*(?://.*)?$')
# Mesa `S:line(col): error: text`; Intel, AMD and Apple `ERROR: S:line: text`; NVIDIA `S(line) : error C0000: text`.
_MESSAGES = (
    re.compile(r"^\d+:(?P<line>\d+)\(\d+\): (?:preprocessor )?error: (?P<text>.*)$", re.MULTILINE),
    re.compile(r"^ERROR: \d+:(?P<line>\d+): (?P<text>.*)$", re.MULTILINE),
    re.compile(r"^\d+\((?P<line>\d+)\) : error \w+: (?P<text>.*)$", re.MULTILINE),
)


@dataclass(frozen=True)
class ShaderSource:
    """One self-contained GLSL text and the files it came from, in the order of LINE_STRIDE's numbering."""

    text: str
    files: tuple[tuple[str, str], ...]  # (name, content)

    def explain(self, log: str, line_offset: int = 0) -> ShaderError:
        """The first error of a compiler log as a ShaderError that names our file and line and shows the line.

        `line_offset` is what the driver adds to the numbers that `#line` sets: 0 by the GLSL standard since 3.30,
        1 on Mesa.
        """
        for pattern in _MESSAGES:
            if not (found := pattern.search(log)):
                continue
            file, number = divmod(int(found["line"]) - line_offset, LINE_STRIDE)
            if 1 <= file <= len(self.files):
                name, content = self.files[file - 1]
                lines = content.splitlines()
                shown = lines[number - 1].strip() if 1 <= number <= len(lines) else ""
                return ShaderError(f"{name}:{number}: {found['text'].strip()}; in the line `{shown}`")
        return ShaderError(f"{self.files[0][0]}: {' '.join(log.split())}")


def with_defines(source: ShaderSource, defines: Mapping[str, object]) -> ShaderSource:
    """The same text with macros before all else, but for those that it begins with already."""
    version, _, rest = source.text.partition("\n")
    head = rest.partition("#line")[0]
    new = [f"#define {name} {value}" for name, value in defines.items() if f"#define {name} " not in head]
    return replace(source, text="\n".join([version, *new, rest]))


def assemble(main: str, root: Path, generated: Mapping[str, str] | None = None,
             defines: Mapping[str, object] | None = None, shown: Mapping[str, str] | None = None) -> ShaderSource:
    """Join `main` (a file name under `root`, or a name in `generated`) with all it includes, each file once.

    `generated` maps include names to texts that exist only in memory; they win over files of the same name. `shown`
    maps include names to what messages call them.
    Raises ShaderError, with file and line, for an include that does not exist.
    """
    generated, shown = generated or {}, shown or {}
    files: list[tuple[str, str]] = []
    numbers: dict[str, int] = {}
    header = [GLSL_VERSION, *(f"#define {name} {value}" for name, value in (defines or {}).items())]

    def read(name: str, included_at: str) -> str:
        if name in generated:
            return generated[name]
        try:
            return (root / name).read_text(encoding="utf-8")
        except OSError:
            raise ShaderError(f'{included_at}: no such shader file "{name}"; looked up in {root}') from None

    def expand(name: str, included_at: str) -> list[str]:
        number = numbers[name] = len(files)
        called, content = shown.get(name, name), read(name, included_at)
        files.append((called, content))
        start = (number + 1) * LINE_STRIDE
        output = [f"#line {start + 1} {number} // {name}"]
        for line, text in enumerate(content.splitlines(), start=1):
            if not (found := _INCLUDE.match(text)):
                output.append(text)
            elif found[1] in numbers:
                output.append("")
            else:
                output += [*expand(found[1], f"{called}:{line}"), f"#line {start + line + 1} {number} // {name}"]
        return output

    text = "\n".join([*header, *expand(main, main)]) + "\n"
    return ShaderSource(text, tuple(files))
