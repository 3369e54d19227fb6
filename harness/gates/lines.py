"""Where the keys of a TOML file stand: what tomllib does not tell, and a message about one of them needs."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

# What may hide a bracket, a newline or a comment sign; anything else is one character.
_TOKEN = re.compile(r'"""(?:\\.|[^\\])*?"""|\'\'\'.*?\'\'\'|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'|#[^\n]*|.', re.DOTALL)
_NAME = r'\s*("(?:\\.|[^"\\])*"|\'[^\']*\'|[A-Za-z0-9_-]+)\s*'
_KEY = re.compile(rf"{_NAME}(?:\.{_NAME})*=")
_PART = re.compile(_NAME)

# A key's way from the top: table names, positions in arrays of tables, keys.
Way = tuple[str | int, ...]


@dataclass(frozen=True)
class Lines:
    """The line of each table header and key of one TOML text, by its way from the top."""

    found: dict[Way, int] = field(default_factory=dict)

    def line(self, *way: str | int) -> int:
        """The line of a key, or of the nearest that encloses it where it stands inside a value; 1 for none."""
        for length in range(len(way), 0, -1):
            if way[:length] in self.found:
                return self.found[way[:length]]
        return 1


def lines(text: str) -> Lines:
    """Find the keys of a text that tomllib has accepted."""
    found: dict[Way, int] = {}
    table: Way = ()
    counts: dict[Way, int] = {}
    for number, statement in _statements(text):
        if statement.startswith("["):
            names = _parts(statement.strip("[] \t"))
            table = _resolved(names[:-1], counts) + names[-1:]
            if statement.startswith("[["):
                counts[table] = counts.get(table, -1) + 1
                found.setdefault(table, number)
                table = (*table, counts[table])
            found.setdefault(table, number)
        elif matched := _KEY.match(statement):
            names = _parts(matched[0][:-1])
            for length in range(1, len(names) + 1):
                found.setdefault(table + names[:length], number)
    return Lines(found)


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Line number and text of each header and each key with its value, comments left out."""
    depth, number, start, pending = 0, 1, 1, ""
    for token in _TOKEN.findall(text + "\n"):
        if token == "\n" and (depth == 0 or pending.startswith("[")):
            if pending.strip():
                yield start, pending.strip()
            pending, depth = "", 0
        elif not token.startswith("#"):
            if not pending.strip():
                pending, start = "", number
            pending += token
            depth += (token in "[{") - (token in "]}")
        number += token.count("\n")


def _parts(dotted: str) -> Way:
    return tuple(part.strip("\"'") for part in _PART.findall(dotted))


def _resolved(names: Way, counts: dict[Way, int]) -> Way:
    """A table's way with the position of the last element of every array of tables that it goes through."""
    way: Way = ()
    for name in names:
        way = (*way, name)
        if way in counts:
            way = (*way, counts[way])
    return way
