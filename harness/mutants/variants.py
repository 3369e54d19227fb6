"""Correct variants: shaders that differ from ours and are right, as data; whoever accuses one is wrong."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.errors import HarnessError
from harness.shader.library import OURS, Library, OwnLine

FOLDER = Path(__file__).parent / "data" / "correct"
_HEADER = re.compile(r"^\s*\[\[\s*variant\s*\]\]")


@dataclass(frozen=True)
class Variant:
    """Lines of the library, each whole and without its indentation, and what stands in their place.

    `why` says what differs, and why it is right; `where`: file and line of the entry, for messages.
    """

    id: str
    why: str
    exchanges: tuple[OwnLine, ...]
    where: str

    @property
    def topic(self) -> str:
        """The file that the variant stands in, such as 'sampling'."""
        return Path(self.where.rpartition(":")[0]).stem

    def applied(self, library: Library = OURS) -> Library:
        """The library with these lines exchanged. HarnessError where one is not there, or there more than once."""
        try:
            for own in self.exchanges:
                library = library.with_line(own.file, own.line, own.replacement)
        except HarnessError as error:
            raise HarnessError(f"{self.where}: variant '{self.id}' does not apply: {error}") from None
        return library


def load_variants(folder: Path = FOLDER) -> tuple[Variant, ...]:
    """Every variant of a folder of TOML files. HarnessError, with file and line, for an entry that is malformed."""
    return tuple(variant for path in sorted(folder.glob("*.toml")) for variant in _load(path))


def _load(path: Path) -> list[Variant]:
    text = path.read_text(encoding="utf-8")
    try:
        entries = tomllib.loads(text).get("variant", [])
    except tomllib.TOMLDecodeError as error:
        raise HarnessError(f"{path}: not TOML: {error}; mend the syntax") from None
    lines = [number for number, line in enumerate(text.splitlines(), start=1) if _HEADER.match(line)]
    return [_entry(entry, f"{path}:{line}") for entry, line in zip(entries, lines, strict=True)]


def _entry(entry: Mapping[str, Any], where: str) -> Variant:
    try:
        return Variant(entry["id"], entry["why"], tuple(OwnLine(**own) for own in entry["exchange"]), where)
    except (KeyError, TypeError) as error:
        raise HarnessError(f"{where}: a variant needs 'id', 'why' and [[variant.exchange]] tables of file, line and "
                           f"replacement ({error})") from None
