"""Somebody's own shader files as a library: ours, with theirs in place of those of the same name."""

from __future__ import annotations

import re
from pathlib import Path

from harness.errors import HarnessError, ShaderError
from harness.shader.library import MAIN, OURS, SUFFIXES, Library, OwnFile
from harness.shader.source import GLSL_VERSION

_VERSION = re.compile(r"^[ \t]*#[ \t]*version\b.*", re.MULTILINE)


def own_library(shader: Path | None, folder: Path | None, ours: Library = OURS) -> Library:
    """The library `ours` with `shader` in place of path_tracer.frag, and the files of `folder` in place of those of the
    same name; messages of the compiler name them by their paths.

    HarnessError for a file that cannot be read, is empty, brings its own #version, or takes a name that is not free.
    """
    own: dict[str, Path] = {}
    if folder:
        own = {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*"))
               if path.suffix in SUFFIXES and not path.name.startswith(".") and path.is_file()}
        if not own:
            raise HarnessError(f"the folder '{folder}' holds no {' and no '.join(SUFFIXES)} file; "
                               "put lib/phong.glsl, for example, into it")
    if shader:
        if MAIN in own:
            raise HarnessError(f"'{own[MAIN]}' and the shader '{shader}' both stand in for {MAIN}; take one away")
        own[shader.name] = shader
    # Names are looked at before texts: a file in the wrong place says so, whatever it holds.
    named = ours.with_files(*(OwnFile(name, "", str(path)) for name, path in own.items()))
    files = (OwnFile(file.name, _text(own[file.name]), file.shown) for file in named.files[len(ours.files):])
    return ours.with_files(*files, main=shader.name if shader else None)


def _text(path: Path) -> str:
    """The text of a shader; a byte-order mark, which editors on Windows write and compilers refuse, is left out."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object[:error.start].count(b"\n") + 1
        raise ShaderError(f"{path}:{line}: not UTF-8 text; save the file in the encoding UTF-8") from None
    except OSError as error:
        raise ShaderError(f"{path}: the shader cannot be read ({error.strerror}); unlock the file") from None
    if not text.strip():
        raise ShaderError(f"{path}:1: the file is empty; all functions of the file that it stands in for must be in it")
    if found := _VERSION.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise ShaderError(f"{path}:{line}: '{found[0].strip()}'; the harness begins the shader with '{GLSL_VERSION}', "
                          "take this line out")
    return text
