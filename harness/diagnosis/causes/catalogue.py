"""The catalogue of causes: semantic defects as data, each one slip, written into every branch of our shader it is in.

A line mutant answers "do the gates notice?". A cause answers "which slip makes this picture?", and a stranger's shader
has its own branches: so one defect is patched into all of ours, and where its image depends on how directions are drawn
it has a picture for each of the ways.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from harness.errors import HarnessError
from harness.scene.footprint import Footprint
from harness.scene.strategies import DRAWS
from harness.shader.library import OURS, Library

FOLDER = Path(__file__).parent / "defects"
LINES = Path(__file__).parent / "lines.toml"
# What a defect's sentence, family and formula may be shown for: see `harness grade --hints`.
_TEXTS = ("id", "says", "family", "formula")
_HEADER = re.compile(r"^[ \t]*\[\[\s*defect\s*\]\]", re.MULTILINE)


@dataclass(frozen=True)
class Picture:
    """One way in which a defect shows: its lines exchanged in our shader, drawn with one of our strategies.

    `edits`: (name in lines.toml, what stands in the place of that line).
    """

    strategy: str
    edits: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Defect:
    """One slip.

    `says` goes on after "ours with"; `family` and `formula` are what a hint may give away: the topic, and how it
    should be. `needs`: texts that must be in a scene's generated code for the defect to show, such as
    "#define HAS_LENS 1". `same_as`: ids of the catalogue of mutants that are this slip in one of our lines. `pixel`:
    the defect is a matter of single pixels, and cannot be seen in an image that was reduced. `footprint`: how it
    spreads rays about a pixel's centre, where that is all it does; it may then be found besides another defect.
    `rounding`: its picture is made by rounding, so another compiler's, or another way to write it, is only much like
    it.
    """

    id: str
    says: str
    family: str
    formula: str
    pictures: tuple[Picture, ...]
    needs: tuple[str, ...] = ()
    same_as: tuple[str, ...] = ()
    pixel: bool = False
    where: str = ""
    footprint: Footprint | None = None
    rounding: bool = False

    def applies(self, scene_code: str) -> bool:
        """Whether a scene's generated code has all that the defect needs."""
        return all(text in scene_code for text in self.needs)


def load_defects(folder: Path = FOLDER) -> tuple[Defect, ...]:
    """Every defect of a folder of TOML files, by file and then in order.

    HarnessError, with file and line, for a malformed file, an unknown or missing key, an unknown line or strategy, or
    an id given twice.
    """
    defects: list[Defect] = []
    for path in sorted(folder.glob("*.toml")):
        defects += _load(path)
    if not defects:
        raise HarnessError(f"{folder}: no defects there; a catalogue is a folder of .toml files with [[defect]] tables")
    first: dict[str, Defect] = {}
    for defect in defects:
        if (other := first.setdefault(defect.id, defect)) is not defect:
            raise HarnessError(f"{defect.where}: the id '{defect.id}' is taken by {other.where}; choose another")
    return tuple(defects)


def defective(picture: Picture, library: Library = OURS) -> Library:
    """The library with a defect in it. HarnessError where a line is not there, or there more than once."""
    lines = known_lines()
    for name, replacement in picture.edits:
        file, line = lines[name]
        library = library.with_line(file, line, replacement)
    return library


@cache
def known_lines() -> dict[str, tuple[str, str]]:
    """The lines that defects are written into, by name: (file under glsl/, line)."""
    return {name: (file, line) for name, (file, line) in _toml(LINES).items()}


def _toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise HarnessError(f"{path}: not TOML: {error}; mend the syntax") from None


def _load(path: Path) -> list[Defect]:
    content = _toml(path)
    if set(content) != {"defect"} or not isinstance(content["defect"], list):
        raise HarnessError(f"{path}:1: expected [[defect]] tables and nothing else, found "
                           f"{', '.join(sorted(content)) or 'nothing'}")
    text = path.read_text(encoding="utf-8")
    rows = [text.count("\n", 0, found.start()) + 1 for found in _HEADER.finditer(text)]
    return [_defect(entry, f"{path}:{row}") for entry, row in zip(content["defect"], rows, strict=True)]


def _defect(entry: Mapping[str, Any], where: str) -> Defect:
    allowed = (*_TEXTS, "needs", "same_as", "pixel", "rounding", "strategies", "edit", "picture",
               "footprint")
    for key in entry:
        if key not in allowed:
            raise HarnessError(f"{where}: unknown key '{key}' of a defect; allowed: {', '.join(allowed)}")
    for key in _TEXTS:
        if not isinstance(entry.get(key), str) or not entry[key].strip():
            raise HarnessError(f"{where}: a defect needs '{key}', a text that is not empty")
    own = [entry] if "edit" in entry else []
    pictures = [picture for part in [*own, *entry.get("picture", [])] for picture in _pictures(part, where)]
    if not pictures:
        raise HarnessError(f"{where}: defect '{entry['id']}' has neither an 'edit' nor a [[defect.picture]]; say which "
                           "lines it changes")
    name, says, family, formula = (entry[key] for key in _TEXTS)
    return Defect(name, says, family, formula, tuple(pictures), needs=tuple(entry.get("needs", ())),
                  same_as=tuple(entry.get("same_as", ())), pixel=bool(entry.get("pixel", False)), where=where,
                  footprint=_footprint(entry, where), rounding=bool(entry.get("rounding", False)))


def _footprint(entry: Mapping[str, Any], where: str) -> Footprint | None:
    """HarnessError for a key that a footprint does not have."""
    if "footprint" not in entry:
        return None
    try:
        return Footprint(**entry["footprint"])
    except TypeError:
        raise HarnessError(f"{where}: a 'footprint' has width, right, down and tent; found "
                           f"{entry['footprint']}") from None


def _pictures(part: Mapping[str, Any], where: str) -> Sequence[Picture]:
    """One picture for each of the strategies; `mixture` where none is named."""
    edits = part.get("edit")
    lines = known_lines()
    if not isinstance(edits, dict) or not edits:
        raise HarnessError(f"{where}: a picture needs an 'edit', a table of names in {LINES.name} and lines")
    for name, replacement in edits.items():
        if name not in lines:
            raise HarnessError(f"{where}: unknown line '{name}'; those that have a name are in {LINES}")
        if not isinstance(replacement, str) or replacement.strip() == lines[name][1].strip():
            raise HarnessError(f"{where}: the replacement of '{name}' must be a text, and another than the line itself")
    strategies = part.get("strategies", ["mixture"])
    for strategy in strategies:
        if strategy not in DRAWS:
            raise HarnessError(f"{where}: unknown strategy '{strategy}'; choose from {', '.join(DRAWS)}")
    return [Picture(strategy, tuple(edits.items())) for strategy in strategies]
