"""Repairs of an author's text: where a known slip of a named cause stands in a line, the same text with it mended."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from harness.errors import HarnessError

FILE = Path(__file__).parent / "repairs.toml"
_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
# What an author may call what a repair needs a name for; the first that is in the text is taken.
NAMES = {"normal": ("normal", "nor", "hit.normal", "rec.normal", "n", "N"),
         "direction": ("newDir", "refDir", "scattered", "direction", "dir", "wi", "rd", "l", "d"),
         "throughput": ("throughput", "mask", "attenuation", "beta", "accucolor", "colmask", "tp"),
         "reflected": ("rd", "ray.direction", "ray.dir", "rayDir", "dir", "d")}


@dataclass(frozen=True)
class Repair:
    """A text with one line mended: `line` (from 1) as it was `before`, as it is `after`; `says` what was done."""

    line: int
    before: str
    after: str
    says: str
    text: str


@dataclass(frozen=True)
class _Slip:
    causes: tuple[str, ...]
    says: str
    pattern: re.Pattern[str]
    replacement: str


def repairs(cause: str, text: str) -> tuple[Repair, ...]:
    """The text with one line mended, once for each place where a known slip of that cause (the id of a defect) stands.

    Nothing is known of the shader but its lines: each is a proposal, to be tried. None where no slip is known. The
    numbers of lines stay as they are.
    """
    lines = text.split("\n")
    code = _without_comments(text).split("\n")
    found: dict[tuple[int, str], Repair] = {}
    for slip in (slip for slip in _slips() if cause in slip.causes):
        for number, (line, bare) in enumerate(zip(lines, code, strict=True)):
            for after in _mended(slip, bare, text):
                comment = line[len(bare.rstrip()):] if line.startswith(bare.rstrip()) else ""
                whole = "\n".join([*lines[:number], after.rstrip() + comment, *lines[number + 1:]])
                found.setdefault((number, after), Repair(number + 1, line.strip(), after.strip(), slip.says, whole))
    return tuple(found.values())


def _mended(slip: _Slip, line: str, text: str) -> Iterator[str]:
    """The line with one of the slip's places in it mended, for each of them."""
    for match in slip.pattern.finditer(line):
        replacement = slip.replacement
        for name, choices in NAMES.items():
            if f"{{{name}}}" in replacement:
                known = next((c for c in choices if re.search(rf"(?<![\w.]){re.escape(c)}\b(?!\s*\()", text)),
                             choices[0])
                replacement = replacement.replace(f"{{{name}}}", known)
        after = line[:match.start()] + match.expand(replacement) + line[match.end():]
        if after != line:
            yield after


def _without_comments(text: str) -> str:
    """The text with spaces for comments, so that lines and columns stay."""
    return _COMMENT.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), text)


@cache
def _slips() -> tuple[_Slip, ...]:
    """The known slips. HarnessError for a malformed file."""
    entries = tomllib.loads(FILE.read_text(encoding="utf-8"))["repair"]
    result = []
    for entry in entries:
        try:
            flags = re.IGNORECASE if "i" in entry.get("flags", "") else 0
            pattern = re.compile(entry["pattern"], flags)
        except re.error as error:
            raise HarnessError(f"{FILE}: the pattern of '{entry['says']}' is no regular expression: {error}; mend "
                               "it") from None
        result.append(_Slip(tuple(entry["causes"]), entry["says"], pattern, entry["replacement"]))
    return tuple(result)
