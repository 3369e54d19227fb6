"""Which dialect files are in: the table of hosts, and the reading of files by it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from harness.errors import HarnessError, ShaderError
from harness.shader.contract import Contract
from harness.shader.decoding import decoded
from harness.shader.hosts import body, desktop, glslviewer, gratin, ours, shadertoy, vscode, webgl
from harness.shader.hosts.reading import PROGRAMS, Answer, Answers, Given

# The first that holds reads; the ones whose marks are the least ambiguous come first.
DIALECTS = (gratin.DIALECT, ours.DIALECT, glslviewer.DIALECT, body.DIALECT, vscode.DIALECT, shadertoy.DIALECT,
            webgl.DIALECT, desktop.DIALECT)
# Files of a folder that may hold a shader.
SUFFIXES = (".glsl", ".frag", ".fs", ".fsh", ".fragment", ".vert", ".vs", ".vsh", ".gra", ".html", ".htm", ".js",
            ".json", ".shader")
_MAIN = re.compile(r"\bvoid\s+main(?:Image)?\s*\(")
_MAX_FILES = 64


def read(files: Sequence[Path], host: str | None = None, values: Mapping[str, Answer] | None = None) -> Contract:
    """The contract of somebody's shader.

    `files`: files, or one folder of them. `host`: the dialect's name, told by syntax if None. `values`: what is said of
    uniforms by name: a value, a role, what a sampler reads ('self', 'pass:NAME', 'noise', …), or a varying's range.

    Raises ShaderError (HarnessError for a host that does not exist) in one line: what was found, where, and how to mend
    it. What nobody knows of a shader that can be run stands in `Contract.unknown`.
    """
    if host is not None and host not in {dialect.name for dialect in DIALECTS}:
        raise HarnessError(f"no host '{host}'; there are {', '.join(dialect.name for dialect in DIALECTS)}")
    given = list(_given(files))
    answers = Answers(dict(values or {}))
    answers.note(*(file.note for file in given))
    for dialect in DIALECTS:
        if dialect.name == host or (host is None and dialect.holds(given)):
            return dialect.read(given, answers)
    raise ShaderError(f"{given[0].name}:1: no shader that is known (no void main(), no void mainImage()); the hosts "
                      f"are {', '.join(dialect.name for dialect in DIALECTS)}")


def _given(files: Sequence[Path]) -> Iterator[Given]:
    if not files:
        raise HarnessError("no shader is named; name its file, or a folder of them")
    for path in files:
        for one in _files_of(path) if path.is_dir() else [path]:
            text = decoded(one)
            yield Given(one, text.text, text.note)


def _files_of(folder: Path) -> list[Path]:
    """The shaders in a folder: one pipeline or export, or all that have the name of a shader."""
    found = [path for path in sorted(folder.iterdir()) if path.is_file() and path.suffix.lower() in SUFFIXES
             and not path.name.startswith(".")]
    for suffix, mark in ((".gra", "<Gratin"), (".json", '"renderpass"')):
        whole = [path for path in found if path.suffix.lower() == suffix and mark in decoded(path).text]
        if len(whole) > 1:
            raise ShaderError(f"{folder}: {len(whole)} files *{suffix} ({whole[0].name}, {whole[1].name} …); name one")
        if whole:
            return whole
    shaders = [path for path in found if path.suffix.lower() not in (".gra", ".json")]
    plain = [path for path in shaders if path.suffix.lower() not in PROGRAMS]
    if any(_MAIN.search(decoded(path).text) for path in plain):
        shaders = plain  # the page that shows them may stand beside them
    if not shaders:
        raise ShaderError(f"{folder}: no shader in this folder; a shader ends in {', '.join(SUFFIXES)}")
    if len(shaders) > _MAX_FILES:
        raise ShaderError(f"{folder}: {len(shaders)} files that may be shaders; name the one that is meant")
    return _without_helpers(shaders)


def _without_helpers(paths: list[Path]) -> list[Path]:
    """Those of a folder's shaders that no other one includes."""
    texts = {path: decoded(path).text for path in paths}
    include = re.compile(r'#[ \t]*include[ \t]*"(?:[^"\n]*/)?([^"/\n]+)"')
    named = {name for text in texts.values() for name in include.findall(text)}
    return [path for path in paths if path.name not in named] or paths
