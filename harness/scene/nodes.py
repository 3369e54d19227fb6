"""One node of a Mitsuba scene file: its properties read by type, anything unread refused with file and line."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.errors import SceneError
from harness.machine.mitsuba_runtime import import_mitsuba

if TYPE_CHECKING:
    from harness.scene.model import RGB

FLOAT32_MAX = float(np.finfo(np.float32).max)  # both renderers compute in float32; beyond it a number is infinite

_LOCATION = re.compile(r"^(?P<file>.*) \(line (?P<line>\d+), col \d+\)$")
# Mitsuba's parser nests its messages, outermost file first: each begins so, in one of three forms.
_FRAME = re.compile(r"\[parser\.cpp:\d+\] ")
_FORMS = (
    re.compile(r"Error while loading (?P<file>.+?) \(line (?P<line>\d+), col \d+\):? (?P<text>.*)"),
    re.compile(r"Parsing of XML file \"(?P<file>.+?)\" failed: (?P<text>.*) \(line (?P<line>\d+), col \d+\)"),
    re.compile(r"Error while loading XML file \"(?P<file>.+?)\": (?P<text>.*)"),
)
_UNPARSED_NUMBER = re.compile(r"could not parse (?:integer|floating point) value \"-?[0-9.]+\"$")


def parse(path: Path, parameters: Iterable[tuple[str, str]] = ()) -> Any:
    """Mitsuba's own parser on one file, with values for its `<default>` parameters: a fresh `mi.parser.ParserState`,
    before any transformation.

    Both sides start here: the loader reads it into a `Scene`, the reference instantiates it.

    Raises SceneError, with file and line, where the file is missing or Mitsuba's parser refuses it.
    """
    mi = import_mitsuba()
    try:
        missing = not path.is_file()
    except OSError:  # a name that the file system cannot hold
        missing = True
    if missing:
        found = "a folder, not a scene file" if os.path.isdir(path) else "no such scene file"
        raise SceneError(f"{path}: {found}; give the path of a Mitsuba 3 .xml scene")
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:  # Mitsuba takes no other names
        raise SceneError(f"{path}: the path must be UTF-8 text; rename the file or its folder") from None
    config = mi.parser.ParserConfig("llvm_ad_rgb")
    try:
        state = mi.parser.parse_file(config, str(path), **dict(parameters))
    except Exception as error:  # the parser raises bare RuntimeError, and TypeError for a bad encoding
        raise _parser_error(path, str(error)) from None
    for file in state.files:
        _require_utf8(Path(str(file)))
    return state


def _parser_error(path: Path, message: str) -> SceneError:
    """The innermost of the parser's nested messages, with the file and line where it arose."""
    file, line, text = str(path), "1", ""
    for text in filter(None, _FRAME.split(" ".join(message.split()))):
        if found := next(filter(None, (form.match(text) for form in _FORMS)), None):
            parts = found.groupdict()
            file, line, text = parts["file"], parts.get("line", "1"), parts["text"]
    if _UNPARSED_NUMBER.search(text):  # what the parser says of a second value for the same property
        text += ", or the property is given twice"
    if "lookat" in text:
        text += ": 'origin' and 'target' must differ, and 'up' must not point along the line between them"
    return SceneError(f"{file}:{line}: {text} (the file must be a Mitsuba 3 XML scene)")


def _require_utf8(path: Path) -> None:
    """Mitsuba hands ids and names on as bytes, which Python then cannot decode."""
    data = path.read_bytes()
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = 1 + data[:error.start].count(b"\n")
        raise SceneError(f"{path}:{line}: not UTF-8 text; save the file in the encoding UTF-8") from None


class Node:
    """A typed, refusing view of one parser node. `done()` refuses every property that nobody asked for."""

    def __init__(self, state: Any, index: int) -> None:
        self._mi = import_mitsuba()
        self.state = state
        self._node = state.nodes[index]
        self._props = self._node.props
        self._unread = dict.fromkeys(self._props.keys())

    @property
    def plugin(self) -> str:
        """The plugin's name: the `type` attribute of the element."""
        return str(self._props.plugin_name())

    @property
    def kind(self) -> str:
        """What the element is: 'shape', 'bsdf', 'emitter', 'sensor', 'film', 'sampler', 'integrator', …"""
        return str(self._node.type).rsplit(".", 1)[-1].lower()

    @property
    def name(self) -> str:
        """The element's id if the file gives one, otherwise empty."""
        identifier = str(self._props.id())
        return "" if identifier.startswith("_unnamed_") else identifier

    @property
    def properties(self) -> Any:
        """What the parser holds, for whoever is content with some of it."""
        return self._props

    def error(self, message: str) -> SceneError:
        """A SceneError at this node's file and line."""
        location = str(self._mi.parser.file_location(self.state, self._node))
        found = _LOCATION.match(location)
        where = f"{found['file']}:{found['line']}" if found else location
        return SceneError(f"{where}: {' '.join(message.split())}")  # names may hold line breaks

    def refuse(self, supported: Iterable[str]) -> SceneError:
        """The error for a plugin outside the supported subset."""
        return self.error(f"{self.kind} '{self.plugin}' is not supported; supported: {', '.join(supported)}")

    def children(self) -> Iterator[tuple[str, Node]]:
        """Nested and referenced objects as (property name, node), in file order."""
        for key in list(self._unread):
            child = self._nested(self._props[key])
            if child is not None:
                del self._unread[key]
                yield key, child

    def nested(self, name: str) -> Node | None:
        """The object that property `name` holds or refers to; None where it is absent or a plain value."""
        child = self._nested(self._props[name]) if name in self._props else None
        if child is not None:
            self._unread.pop(name, None)
        return child

    @property
    def file(self) -> Path:
        """The file in which the element stands; file names inside it are relative to its folder."""
        return Path(str(self.state.files[self._node.file_index]))

    def ignore(self, *names: str) -> None:
        """Accept properties that change neither renderer's image (a film's file format, say)."""
        for name in names:
            self._unread.pop(name, None)

    def number(self, name: str, default: float | None = None) -> float:
        """A finite float or integer property."""
        value = self._take(name, default)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.error(f"'{name}' must be a number, found {_shown(value)}")
        if not _representable(value):
            raise self.error(f"'{name}' must be finite and at most {FLOAT32_MAX:.2g}, found {value:g}")
        return float(value)

    def integer(self, name: str, default: int | None = None) -> int:
        """An integer property."""
        value = self._take(name, default)
        if isinstance(value, bool) or not isinstance(value, int):
            raise self.error(f"'{name}' must be an integer, found {_shown(value)}")
        return value

    def boolean(self, name: str, default: bool) -> bool:
        """A boolean property."""
        value = self._take(name, default)
        if not isinstance(value, bool):
            raise self.error(f"'{name}' must be true or false, found {_shown(value)}")
        return value

    def string(self, name: str, default: str) -> str:
        """A string property."""
        value = self._take(name, default)
        if not isinstance(value, str):
            raise self.error(f"'{name}' must be a string, found {_shown(value)}")
        return value

    def point(self, name: str, default: tuple[float, float, float]) -> np.ndarray:
        """A point or vector property as (3,) float64."""
        value = np.asarray(self._take(name, default), dtype=np.float64)
        if value.shape != (3,) or not _representable(value):
            raise self.error(f"'{name}' must be a point of three finite numbers")
        return value

    def rgb(self, name: str, default: float | None = None, *, emission: bool = False) -> RGB:
        """A colour, a number (grey) or a uniform spectrum; finite and not negative.

        A spectrum that is uniform over wavelengths is grey as a reflectance, but as an `emission` it has a tint.
        """
        value = self._take(name, default)
        if hasattr(value, "is_uniform") and not isinstance(value, int | float):
            if emission or not value.is_uniform():
                raise self.error(f"'{name}' is a spectrum; give it as <rgb> or <float>")
            value = float(np.ravel(value.values)[0])
        if isinstance(value, str | bool) or value is None:
            raise self.error(f"'{name}' must be a colour or a number, found {_shown(value)}")
        try:
            colour = np.broadcast_to(np.asarray(value, dtype=np.float64), (3,))
        except (TypeError, ValueError):
            raise self.error(f"'{name}' must be a colour or a number, found {_shown(value)}") from None
        if not (_representable(colour) and (colour >= 0).all()):
            raise self.error(f"'{name}' must be finite and not negative, found {', '.join(f'{c:g}' for c in colour)}")
        return (float(colour[0]), float(colour[1]), float(colour[2]))

    def transform(self, name: str = "to_world") -> np.ndarray:
        """An affine, invertible 4x4 transform, (4, 4) float64; the identity where the file gives none."""
        value = self._take(name, np.eye(4))
        matrix = np.array(getattr(value, "matrix", value), dtype=np.float64)
        if matrix.shape != (4, 4):
            raise self.error(f"'{name}' must be a <transform>, found {_shown(value)}")
        if not _representable(matrix) or not np.array_equal(matrix[3], [0, 0, 0, 1]):
            raise self.error(f"'{name}' must be a finite affine transform")
        linear = matrix[:3, :3]
        # Relative to the volume that its columns would span if they were orthogonal: scale does not matter.
        if abs(np.linalg.det(linear)) <= 1e-9 * np.prod(np.linalg.norm(linear, axis=0)):
            raise self.error(f"'{name}' is degenerate (it flattens the object); every scale factor must differ from 0")
        if not _representable(np.linalg.inv(matrix)):
            raise self.error(f"'{name}' makes the object too small for float32; scale it up")
        return matrix

    def __contains__(self, name: str) -> bool:
        return name in self._props

    def done(self, supported: Iterable[str]) -> None:
        """Refuse what nobody read; `supported` is listed in the message."""
        if self._unread:
            name = next(iter(self._unread))
            allowed = ", ".join(supported) or "none"
            raise self.error(f"property '{name}' of {self.kind} '{self.plugin}' is not supported; supported: {allowed}")

    def _take(self, name: str, default: Any) -> Any:
        if name not in self._props:
            if default is None:
                raise self.error(f"{self.kind} '{self.plugin}' needs '{name}'")
            return default
        self._unread.pop(name, None)
        value = self._props[name]
        if child := self._nested(value):
            raise child.refuse(["a plain value, such as a colour or a number"])
        return value

    def _nested(self, value: Any) -> Node | None:
        """The node that a property holds or refers to; None for a plain value."""
        if isinstance(value, self._mi.Properties.ResolvedReference):
            return Node(self.state, value.index())
        if isinstance(value, self._mi.Properties.Reference):
            if value.id() not in self.state.id_to_index:
                raise self.error(f"reference to unknown id '{value.id()}'; define an element with that id")
            return Node(self.state, self.state.id_to_index[value.id()])
        return None


def _representable(values: Any) -> bool:
    """Whether all are finite in float32; False for NaN."""
    return bool((np.abs(values) <= FLOAT32_MAX).all())


def _shown(value: Any) -> str:
    return f"'{value}'" if isinstance(value, str) else f"{value} ({type(value).__name__})"
