"""The shader of a gate: ours, with somebody's own files in place of those of the same name."""

from __future__ import annotations

import re
from pathlib import Path

from harness.errors import ShaderError
from harness.files import data_dir
from harness.gates.model import Gate
from harness.scene import Scene
from harness.shader.scene.chunk import scene_chunk
from harness.shader.source import GLSL_VERSION, ShaderSource, assemble

MAIN = "path_tracer.frag"
GENERATED = "scene.glsl"
SUFFIXES = (".glsl", ".frag")
_VERSION = re.compile(r"^[ \t]*#[ \t]*version\b.*", re.MULTILINE)


def gate_source(gate: Gate, scene: Scene) -> ShaderSource:
    """The shader of a gate: ours, with what `shader` and `glsl` put in place of files of the same name.

    Messages of the compiler name the gate's own files by their paths. HarnessError for a file that cannot be read, is
    empty, or stands in for nothing: a gate must not pass because the shader under test is not in it.
    """
    main = gate.shader.name if gate.shader else MAIN
    own = _own_files(gate)
    source = assemble(main, data_dir("glsl"), {GENERATED: scene_chunk(scene, gate.strategy),
                                               **{name: _text(path) for name, path in own.items()}},
                      shown={name: str(path) for name, path in own.items()})
    included, library = {name for name, _ in source.files}, _library()
    for name, path in own.items():
        if str(path) not in included and name not in library:  # the library's own may be of no use in this scene
            raise gate.error(_stray(gate, path, library))
    return source


def _own_files(gate: Gate) -> dict[str, Path]:
    """The gate's own files, by the name under which a shader includes each."""
    own: dict[str, Path] = {}
    if gate.glsl:
        own = {path.relative_to(gate.glsl).as_posix(): path for path in sorted(gate.glsl.rglob("*"))
               if path.suffix in SUFFIXES and not path.name.startswith(".") and path.is_file()}
        if not own:
            raise gate.error(f"the folder '{gate.glsl}' holds no {' and no '.join(SUFFIXES)} file; "
                             "put lib/phong.glsl, for example, into it")
    if gate.shader:
        if MAIN in own:
            raise gate.error(f"'{own[MAIN]}' and the shader '{gate.shader}' both stand in for {MAIN}; take one away")
        own[gate.shader.name] = gate.shader
    if GENERATED in own:
        raise gate.error(f"'{own[GENERATED]}' cannot stand in for {GENERATED}, which is written from the scene; "
                         "give it another name, or take it away")
    return own


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


def _library() -> set[str]:
    root = data_dir("glsl")
    return {path.relative_to(root).as_posix() for path in root.rglob("*") if path.suffix in SUFFIXES}


def _stray(gate: Gate, path: Path, library: set[str]) -> str:
    """What to say of a file that no shader includes."""
    message = f"'{path}' stands in for nothing and nothing includes it"
    near = sorted(name for name in library if Path(name).name == path.name)
    if near and gate.glsl:
        return f"{message}; to stand in for the harness's {near[0]} it must be '{gate.glsl / near[0]}'"
    return f"{message}; give it the name of a file of the harness's glsl folder, include it, or take it away"
