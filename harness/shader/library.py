"""The shader library as a value: our GLSL, but for files, functions, lines and defines that somebody exchanged."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from types import MappingProxyType

from harness.errors import HarnessError
from harness.files import data_dir
from harness.scene.model import Scene
from harness.shader.overrides import override
from harness.shader.scene.chunk import scene_chunk
from harness.shader.source import ShaderSource, assemble

MAIN = "path_tracer.frag"
GENERATED = "scene.glsl"  # written from the scene
# What lib/path.glsl takes for granted of our own files, by the define that says so: 0 where one of them is another's.
GRANTED = {"STARTS_AHEAD": ("lib/random.glsl",), "BITMAPS_AHEAD": ("lib/bitmaps.glsl",),
           "ENDS_BY_DIRECTION": ("lib/bsdf.glsl", "lib/phong.glsl", "lib/sampling.glsl")}
SUFFIXES = (".glsl", ".frag")


@dataclass(frozen=True)
class OwnFile:
    """A file that stands in for the library's of the same `name` (as shaders include it), or that such a file includes.

    `shown`: what messages call it.
    """

    name: str
    text: str
    shown: str


@dataclass(frozen=True)
class OwnLine:
    """A line of a library file, without its indentation, and what stands in its place."""

    file: str
    line: str
    replacement: str


@dataclass(frozen=True)
class Library:
    """Our GLSL, but for single `lines`, `files`, and functions that `chunks` (files under glsl/) define anew.

    Lines are exchanged in ours; a file of one's own comes as it is.

    `main`: the file with `main`, ours unless a file of another name takes its place; `defines` stand before all else.
    Frozen, hashable and picklable: a mutant, an exhibit, a student's folder and ours are all libraries.
    """

    files: tuple[OwnFile, ...] = ()
    lines: tuple[OwnLine, ...] = ()
    chunks: tuple[str, ...] = ()
    defines: tuple[tuple[str, object], ...] = ()
    main: str = MAIN

    def with_files(self, *files: OwnFile, main: str | None = None) -> Library:
        """The same with these files in place of those of the same name, and another file with `main` if one is given.

        HarnessError for the name of the file that is written from the scene.
        """
        for file in files:
            if file.name == GENERATED:
                raise HarnessError(f"'{file.shown}' cannot stand in for {GENERATED}, which is written from the scene; "
                                   "give it another name, or take it away")
        return replace(self, files=(*self.files, *files), main=main or self.main)

    def with_line(self, file: str, line: str, replacement: str) -> Library:
        """The same with one line exchanged, its indentation kept.

        HarnessError where there is no such file, or the line is not there, or there more than once.
        """
        changed = replace(self, lines=(*self.lines, OwnLine(file, line, replacement)))
        changed._texts()
        return changed

    def with_functions(self, *chunks: str, defines: Mapping[str, object] | None = None) -> Library:
        """The same with the functions of these files under glsl/ in place of those of the same name in lib/."""
        return replace(self, chunks=(*self.chunks, *chunks),
                       defines=(*self.defines, *sorted((defines or {}).items())))

    @property
    def digest(self) -> str:
        """16 hexadecimal digits over all of its text, whether a scene has a use for it or not."""
        whole = hashlib.sha256(repr((self.main, self.defines)).encode())
        texts = {name: text for name, text in _ours().items() if not name.startswith(("probes/", "starts/"))}
        for name, text in sorted((texts | self._texts()).items()):
            whole.update(f"{name}\0{text}\0".encode())
        return whole.hexdigest()[:16]

    def tracer(self, scene: Scene, strategy: str) -> ShaderSource:
        """The self-contained path tracer for one scene and strategy.

        HarnessError for a file of one's own that stands in for nothing and that nothing includes: what is judged must
        be in the shader. ShaderError for an include that does not exist.
        """
        source = self.assembled(self.main, {GENERATED: scene_chunk(scene, strategy)})
        included = {name for name, _ in source.files}
        for file in self.files:
            if file.shown not in included and file.name not in _ours():  # ours may be of no use in this scene
                raise HarnessError(_stray(file))
        return source

    def probe(self, name: str, generated: Mapping[str, str] | None = None,
              defines: Mapping[str, object] | None = None) -> ShaderSource:
        """`glsl/probes/<name>`: a shader that evaluates functions of this library; arguments as for `assemble`."""
        return self.assembled(f"probes/{name}", generated, defines)

    def assembled(self, main: str, generated: Mapping[str, str] | None = None,
                  defines: Mapping[str, object] | None = None) -> ShaderSource:
        """`main` with all that it includes; `generated` and `defines` as for `assemble`."""
        texts = self._texts()
        changed = {name for name, text in texts.items() if text != _ours().get(name)}
        not_granted = {name: 0 for name, files in GRANTED.items() if changed.intersection(files)}
        return assemble(main, data_dir("glsl"), {**texts, **(generated or {})},
                        {**not_granted, **dict(self.defines), **(defines or {})},
                        {file.name: file.shown for file in self.files})

    def _texts(self) -> dict[str, str]:
        """The files that differ from ours, by name."""
        changed: dict[str, str] = {}
        for own in self.lines:
            text = changed.get(own.file, _ours().get(own.file))
            if text is None:
                raise HarnessError(f"no shader file '{own.file}' in {data_dir('glsl')}; name a file there")
            changed[own.file] = exchange_line(text, own)
        changed |= {file.name: file.text for file in self.files}
        return changed | override({**_ours(), **changed}, *self.chunks) if self.chunks else changed


OURS = Library()


def exchange_line(text: str, own: OwnLine) -> str:
    """The text of a file with one line exchanged. HarnessError where it is not there, or there more than once."""
    lines = text.splitlines(keepends=True)
    found = [number for number, line in enumerate(lines) if line.strip() == own.line.strip()]
    if len(found) != 1:
        times = "is not in" if not found else f"occurs {len(found)} times in"
        raise HarnessError(f"its line {times} {own.file}: `{own.line.strip()}`; copy the line as it stands there now")
    number = found[0]
    indent = lines[number][:len(lines[number]) - len(lines[number].lstrip())]
    lines[number] = f"{indent}{own.replacement.strip()}\n"
    return "".join(lines)


def _ours() -> Mapping[str, str]:
    """The text of every file under glsl/, by the name under which shaders include it."""
    root = data_dir("glsl")
    return _read(root, tuple((path, path.stat().st_mtime_ns) for path in _shaders(root)))


@functools.lru_cache(maxsize=4)
def _read(root: Path, files: tuple[tuple[Path, int], ...]) -> Mapping[str, str]:
    """Of files with the times when they were last written, so that an edited one is read anew."""
    return MappingProxyType({path.relative_to(root).as_posix(): path.read_text(encoding="utf-8") for path, _ in files})


def _shaders(root: Path) -> Iterator[Path]:
    yield from (path for path in sorted(root.rglob("*")) if path.suffix in SUFFIXES)


def _stray(file: OwnFile) -> str:
    """What to say of a file that no shader includes."""
    message = f"'{file.shown}' stands in for nothing and nothing includes it"
    near = sorted(name for name in _ours() if PurePosixPath(name).name == PurePosixPath(file.name).name)
    if near and file.shown.endswith(file.name):
        folder = Path(file.shown.removesuffix(file.name))
        return f"{message}; to stand in for the harness's {near[0]} it must be '{folder / near[0]}'"
    return f"{message}; give it the name of a file of the harness's glsl folder, include it, or take it away"
