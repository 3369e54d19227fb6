"""The catalogue of mutants: one-line defects of the shader as data, and how one is applied."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from harness.errors import HarnessError
from harness.shader.library import OURS, Library

FOLDER = Path(__file__).parent / "data"

_HEADER = re.compile(r"^\s*\[\[\s*mutant\s*\]\]")


@dataclass(frozen=True)
class Mutant:
    """One line of one shader file, and what stands in its place.

    `line` is the whole line without its indentation and occurs once in `file` (a path under `glsl/`). `imitates` says
    what the defect is in a programmer's words, `origin` where it was seen, `killer` which gate should notice it.
    `where`: file and line of the entry in the catalogue, for messages.
    """

    id: str
    file: str
    line: str
    replacement: str
    imitates: str
    origin: str
    killer: str
    where: str

    @property
    def topic(self) -> str:
        """The catalogue file that the mutant stands in, such as 'sampling'."""
        return Path(self.where.rpartition(":")[0]).stem


def load_catalogue(folder: Path = FOLDER) -> tuple[Mutant, ...]:
    """Every mutant of a folder of TOML files, by file and then in order.

    HarnessError, with file and line, for a malformed file, a missing or unknown key, an empty value, an id given
    twice, or a replacement that is the line itself.
    """
    mutants: list[Mutant] = []
    for path in sorted(folder.glob("*.toml")):
        mutants += _load(path)
    if not mutants:
        raise HarnessError(f"{folder}: no mutants there; a catalogue is a folder of .toml files with [[mutant]] tables")
    first: dict[str, Mutant] = {}
    for mutant in mutants:
        if (other := first.setdefault(mutant.id, mutant)) is not mutant:
            raise HarnessError(f"{mutant.where}: the id '{mutant.id}' is taken by {other.where}; choose another")
    return tuple(mutants)


def mutated(mutant: Mutant, library: Library = OURS) -> Library:
    """The library with the defect in it.

    HarnessError where the line is not there, or there more than once: the shader has changed, and the catalogue has to.
    """
    try:
        return library.with_line(mutant.file, mutant.line, mutant.replacement)
    except HarnessError as error:
        raise HarnessError(f"{mutant.where}: mutant '{mutant.id}' does not apply: {error}") from None


def choose(mutants: Sequence[Mutant], names: Sequence[str]) -> tuple[Mutant, ...]:
    """The mutants with these ids or of these topics; all where no name is given. HarnessError for an unknown name."""
    known = {mutant.id for mutant in mutants} | {mutant.topic for mutant in mutants}
    for name in names:
        if name not in known:
            raise HarnessError(f"unknown mutant '{name}'; give ids, or topics: "
                               f"{', '.join(sorted({mutant.topic for mutant in mutants}))}")
    return tuple(m for m in mutants if not names or m.id in names or m.topic in names)


def _load(path: Path) -> list[Mutant]:
    text = path.read_text(encoding="utf-8")
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        place = re.search(r"at line (\d+)", str(error))
        line = place[1] if place else len(text.splitlines())  # "at end of document"
        raise HarnessError(f"{path}:{line}: not TOML: {error}; mend the syntax") from None
    entries = content.get("mutant", [])
    if set(content) != {"mutant"} or not isinstance(entries, list):
        raise HarnessError(f"{path}:1: expected [[mutant]] tables and nothing else, found "
                           f"{', '.join(sorted(content)) or 'nothing'}")
    lines = [number for number, line in enumerate(text.splitlines(), start=1) if _HEADER.match(line)]
    return [_entry(entry, f"{path}:{line}") for entry, line in zip(entries, lines, strict=True)]


def _entry(entry: Mapping[str, Any], where: str) -> Mutant:
    wanted = [field.name for field in fields(Mutant) if field.name != "where"]
    for key in entry:
        if key not in wanted:
            raise HarnessError(f"{where}: unknown key '{key}' of a mutant; allowed: {', '.join(wanted)}")
    for key in wanted:
        if not isinstance(entry.get(key), str) or not entry[key].strip():
            raise HarnessError(f"{where}: a mutant needs '{key}', a text that is not empty")
    mutant = Mutant(**entry, where=where)
    if mutant.line.strip() == mutant.replacement.strip():
        raise HarnessError(f"{where}: the replacement of mutant '{mutant.id}' is the line itself; change something")
    return mutant
