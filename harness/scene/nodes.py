"""One node of a Mitsuba scene file: its properties read by type, anything unread refused with file and line."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.errors import SceneError
from harness.mitsuba_runtime import import_mitsuba
from harness.scene.model import RGB

if TYPE_CHECKING:
    from pathlib import Path

_LOCATION = re.compile(r"^(?P<file>.*) \(line (?P<line>\d+), col \d+\)$")
_PARSER_PREFIX = re.compile(r"^\[parser\.cpp:\d+\] ")
_PARSER_LOCATION = re.compile(r"\(line (?P<line>\d+), col \d+\):?\s*")


def parse(path: Path) -> Any:
    """Mitsuba's own parser on one file: a fresh `mi.parser.ParserState`, before any transformation.

    Both sides start here: the loader reads it into a `Scene`, the reference instantiates it.

    Raises SceneError, with file and line, where the file is missing or Mitsuba's parser refuses it.
    """
    mi = import_mitsuba()
    if not path.is_file():
        raise SceneError(f"{path}: no such scene file; give the path of a Mitsuba 3 .xml scene")
    config = mi.parser.ParserConfig("llvm_ad_rgb")
    try:
        return mi.parser.parse_file(config, str(path))
    except Exception as error:  # the parser raises bare RuntimeError, and TypeError for a bad encoding
        message = _PARSER_PREFIX.sub("", " ".join(str(error).split()))
        found = _PARSER_LOCATION.search(message)
        line = f":{found['line']}" if found else ""
        message = _PARSER_LOCATION.sub("", message)
        message = re.sub(r"^(Error while loading \S+|Parsing of XML file \"[^\"]*\" failed):?\s*", "", message)
        raise SceneError(f"{path}{line}: {message.strip()} (the file must be a Mitsuba 3 XML scene)") from None


class Node:
    """A typed, refusing view of one parser node. `done()` refuses every property that nobody asked for."""

    def __init__(self, state: Any, index: int) -> None:
        self._mi = import_mitsuba()
        self.state = state
        self._node = state.nodes[index]
        self._props = self._node.props
        self._unread = {key: None for key in self._props.keys()}

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

    def error(self, message: str) -> SceneError:
        """A SceneError at this node's file and line."""
        location = str(self._mi.parser.file_location(self.state, self._node))
        found = _LOCATION.match(location)
        where = f"{found['file']}:{found['line']}" if found else location
        return SceneError(f"{where}: {message}")

    def refuse(self, supported: Iterable[str]) -> SceneError:
        """The error for a plugin outside the supported subset."""
        return self.error(f"{self.kind} '{self.plugin}' is not supported; supported: {', '.join(supported)}")

    def children(self) -> Iterator[tuple[str, Node]]:
        """Nested and referenced objects as (property name, node), in file order."""
        properties = self._mi.Properties
        for key in list(self._unread):
            value = self._props[key]
            if isinstance(value, properties.ResolvedReference):
                index = value.index()
            elif isinstance(value, properties.Reference):
                if value.id() not in self.state.id_to_index:
                    raise self.error(f"reference to unknown id '{value.id()}'; define an element with that id")
                index = self.state.id_to_index[value.id()]
            else:
                continue
            del self._unread[key]
            yield key, Node(self.state, index)

    def ignore(self, *names: str) -> None:
        """Accept properties that change neither renderer's image (a film's file format, say)."""
        for name in names:
            self._unread.pop(name, None)

    def number(self, name: str, default: float | None = None) -> float:
        """A finite float or integer property."""
        value = self._take(name, default)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.error(f"'{name}' must be a number, found {_shown(value)}")
        if not np.isfinite(value):
            raise self.error(f"'{name}' must be finite, found {value}")
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
        if value.shape != (3,) or not np.isfinite(value).all():
            raise self.error(f"'{name}' must be a point of three finite numbers")
        return value

    def rgb(self, name: str, default: float | None = None) -> RGB:
        """A colour, a number (grey) or a uniform spectrum; finite and not negative."""
        value = self._take(name, default)
        if hasattr(value, "is_uniform") and not isinstance(value, int | float):
            if not value.is_uniform():
                raise self.error(f"'{name}' is a wavelength-dependent spectrum; give it as <rgb> or one number")
            value = float(np.ravel(value.values)[0])
        if isinstance(value, str | bool) or value is None:
            raise self.error(f"'{name}' must be a colour or a number, found {_shown(value)}")
        try:
            colour = np.broadcast_to(np.asarray(value, dtype=np.float64), (3,))
        except (TypeError, ValueError):
            raise self.error(f"'{name}' must be a colour or a number, found {_shown(value)}") from None
        if not (np.isfinite(colour).all() and (colour >= 0).all()):
            raise self.error(f"'{name}' must be finite and not negative, found {', '.join(f'{c:g}' for c in colour)}")
        return (float(colour[0]), float(colour[1]), float(colour[2]))

    def transform(self, name: str = "to_world") -> np.ndarray:
        """An affine, invertible 4x4 transform, (4, 4) float64; the identity where the file gives none."""
        value = self._take(name, np.eye(4))
        matrix = np.array(getattr(value, "matrix", value), dtype=np.float64)
        if not np.isfinite(matrix).all() or not np.array_equal(matrix[3], [0, 0, 0, 1]):
            raise self.error(f"'{name}' must be a finite affine transform")
        linear = matrix[:3, :3]
        # Relative to the volume that its columns would span if they were orthogonal: scale does not matter.
        if abs(np.linalg.det(linear)) <= 1e-9 * np.prod(np.linalg.norm(linear, axis=0)):
            raise self.error(f"'{name}' is degenerate (it flattens the object); every scale factor must differ from 0")
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
        return self._props[name]


def _shown(value: Any) -> str:
    return f"'{value}'" if isinstance(value, str) else f"{value} ({type(value).__name__})"
