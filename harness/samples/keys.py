"""Keys computed, never listed: digests of plain values, and of the code that a stored number depends on."""

from __future__ import annotations

import ast
import dataclasses
import hashlib
import json
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.errors import StoreError
from harness.files import cache_dir, write_atomically

PACKAGE = Path(__file__).resolve().parents[1]
# Digits of a digest of code: 64 bits, and nobody changes code 2^32 times.
CODE_DIGITS = 16
# Files whose digests are remembered; beyond, those noted first are forgotten. The harness has about 200.
REMEMBERED = 1000


class _File(NamedTuple):
    """What a file of Python says: a digest without comments and docstrings, and the names that it imports."""

    digest: str
    imports: tuple[str, ...]


def digest(content: object, digits: int = 64) -> str:
    """The first `digits` hexadecimal digits of the SHA-256 of a plain value, written as JSON with sorted keys.

    Dataclasses count by their fields, arrays by shape, type and bytes. Raises TypeError for what else JSON has no word
    for.
    """
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=_plain).encode()).hexdigest()[:digits]


def _plain(value: object) -> object:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {name: getattr(value, name) for name in _fields(type(value))}
    if isinstance(value, np.ndarray | np.generic):
        data = np.ascontiguousarray(value)
        return [list(data.shape), data.dtype.str, hashlib.sha256(data.data if data.size else b"").hexdigest()]
    raise TypeError(f"a {type(value).__name__} has no digest")


@cache
def _fields(kind: Any) -> tuple[str, ...]:
    """Of a study's table there are a thousand."""
    return tuple(field.name for field in dataclasses.fields(kind))


def folder_digest(folder: Path, *suffixes: str) -> str:
    """A digest of the files below `folder` that end so, names and bytes: for GLSL, which counts as it is written."""
    files = sorted(path for path in folder.rglob("*") if path.suffix in suffixes)
    return digest([[str(path.relative_to(folder)), hashlib.sha256(path.read_bytes()).hexdigest()] for path in files])


@cache
def code_digest(*modules: str, root: Path = PACKAGE) -> str:
    """16 hexadecimal digits over modules ("harness.gpu.renderer") and all of the harness that they import.

    Imports are followed wherever they stand, within functions and under TYPE_CHECKING too, and to the `__init__` of
    each package on the way. What counts is the syntax tree, so comments, docstrings and line breaks invalidate
    nothing. `harness/__init__.py` is left out: it only names what is public. Computed once a process, for what runs
    is what was imported. `root`: the folder of another copy of the package.

    Raises ValueError for a module that is not there.
    """
    known = _remembered()
    fresh: dict[str, _File] = {}
    found: dict[str, str] = {}
    path_of = cache(_path)  # of this call: each module is imported many times
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        path = path_of(name, root)
        if path is None:
            raise ValueError(f"no module '{name}' in {root}")
        source = path.read_bytes()
        content = hashlib.sha256(source).hexdigest()
        file = known.get(content) or fresh.get(content)
        if file is None:
            file = fresh[content] = _parsed(source)
        found[name] = file.digest
        package = name if path.name == "__init__.py" else name.rpartition(".")[0]
        waiting += set(_targets(file.imports, package, root, path_of)) - found.keys()
    if fresh:
        _remember({**known, **fresh})
    return digest(found, CODE_DIGITS)


def _path(name: str, root: Path) -> Path | None:
    """The file of a module or package below `root`; None where there is none, as for a function's name."""
    place = root.joinpath(*name.split(".")[1:])
    return next((path for path in (place.with_suffix(".py"), place / "__init__.py") if path.is_file()), None)


def _targets(imports: tuple[str, ...], package: str, root: Path,
             path_of: Callable[[str, Path], Path | None]) -> Iterator[str]:
    """The modules of the harness behind imported names, and the packages that they lie in."""
    top = package.partition(".")[0]
    for name in imports:
        level = len(name) - len(name.lstrip("."))
        if level:  # relative: one dot is this package, each further one its parent
            parts = package.split(".")
            name = ".".join([*parts[:len(parts) - level + 1], name[level:]])
        parts = name.split(".")
        if parts[0] != top:
            continue
        for length in range(2, len(parts) + 1):
            module = ".".join(parts[:length])
            if path_of(module, root) is None:
                break  # what a module holds, not a module
            yield module


def _parsed(source: bytes) -> _File:
    tree = ast.parse(source)
    imports: list[str] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imports += (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            origin = "." * node.level + (node.module or "")
            imports += (f"{origin}{'' if origin.endswith('.') else '.'}{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            _drop_docstring(node)
    return _File(hashlib.sha256(ast.dump(tree).encode()).hexdigest(), tuple(sorted(set(imports))))


def _drop_docstring(node: ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) -> None:
    match node.body:
        case [ast.Expr(value=ast.Constant(value=str())), *rest]:
            node.body = rest


def _memory() -> Path:
    """Where the digests of files are kept, by the bytes of each file, this one among them, and Python's version.

    To parse the tracer's hundred files takes a fifth of a second, which every command would pay; to read and hash them,
    a hundredth.
    """
    own = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:CODE_DIGITS]
    return cache_dir() / "code" / f"{own}-{sys.version_info.major}.{sys.version_info.minor}.json"


def _remembered() -> Mapping[str, _File]:
    """What earlier processes parsed; nothing where that is missing or damaged."""
    try:
        held: dict[str, Any] = json.loads(_memory().read_text(encoding="utf-8"))
        return {str(content): _File(str(file[0]), tuple(map(str, file[1]))) for content, file in held.items()}
    except (OSError, ValueError, TypeError, AttributeError, LookupError):
        return {}


def _remember(files: Mapping[str, _File]) -> None:
    """Keep it for later processes, if the cache can be written."""
    kept = dict(list(files.items())[-REMEMBERED:])
    with suppress(StoreError), write_atomically(_memory()) as partial:
        partial.write_text(json.dumps(kept), encoding="utf-8")
