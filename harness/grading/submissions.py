"""Which submissions a folder holds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from harness.errors import HarnessError

# What a shader can stand in.
SUFFIXES = (".gra", ".glsl", ".frag", ".fs", ".fsh", ".json", ".html", ".htm", ".js", ".vue")


@dataclass(frozen=True)
class Submission:
    """One student's files, or the folder that holds them all: what is read of a folder is told by what is in it."""

    name: str
    files: tuple[Path, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the files, those of a folder one by one."""
        return tuple(file.name for given in self.files
                     for file in (sorted(filter(_is_shader, given.iterdir())) if given.is_dir() else [given]))


def submissions(folder: Path) -> tuple[Submission, ...]:
    """One for each file in a folder, and one for each folder in it with all its shaders, by name.

    Hidden files, and what is no shader by its suffix, are left out. HarnessError for a folder that is none, that holds
    no shader, or two submissions of one name (`ada.frag` beside `ada/`), whose pages would be one.
    """
    if not folder.is_dir():
        raise HarnessError(f"{folder}: no such folder; name the one that holds the submissions")
    found: dict[str, Submission] = {}
    for path in sorted(folder.iterdir()):
        if path.name.startswith("."):
            continue
        if path.is_dir():
            files = tuple(sorted(file for file in path.rglob("*") if _is_shader(file) and not _is_hidden(file, path)))
            if files and all(file.parent == path for file in files):
                files = (path,)
            name = path.name
        else:
            files, name = ((path,), path.stem) if _is_shader(path) else ((), path.stem)
        if not files:
            continue
        if name in found:
            name_of = found[name].files[0]
            raise HarnessError(f"{path}: a second submission called '{name}' beside {name_of}; rename one, since each "
                               "has a page of its name")
        found[name] = Submission(name, files)
    if not found:
        raise HarnessError(f"{folder}: holds no shader; expected files, or one folder a student, that end in "
                           f"{', '.join(SUFFIXES)}")
    return tuple(found.values())


def _is_shader(path: Path) -> bool:
    return path.is_file() and path.suffix.lower() in SUFFIXES


def _is_hidden(path: Path, below: Path) -> bool:
    return any(part.startswith((".", "__")) for part in path.relative_to(below).parts)
