"""Records as JSON files: dataclasses to plain values and back, written whole or not at all, refused in one line."""

from __future__ import annotations

import dataclasses
import json
import math
import types
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np

from harness.errors import StoreError
from harness.files import write_atomically

T = TypeVar("T")


def save(path: Path, value: object, *, indent: int | None = 1) -> None:
    """Write `plain(value)` as JSON, atomically. StoreError when that cannot be written."""
    text = json.dumps(plain(value), indent=indent, ensure_ascii=False, allow_nan=False)
    with write_atomically(path) as partial:
        partial.write_text(text + "\n", encoding="utf-8")


def load(path: Path, read: Callable[[Any], T], *, what: str, mend: str, missing: str = "") -> T:
    """What `read` makes of a JSON file.

    StoreError, one line with the file, `what` it is not and how to `mend` it, where it cannot be read, is damaged, or
    where `read` raises ValueError, KeyError, TypeError or AttributeError; `missing`: what to say where there is no
    file and that needs other words. A StoreError of `read` passes.
    """
    try:
        return read(json.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        if missing and isinstance(error, FileNotFoundError):
            raise StoreError(f"{path}: {missing}") from error
        raise StoreError(f"{path}: not {what} (cannot be read: {error.strerror}); {mend}") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:  # malformed JSON and what is not UTF-8, too
        raise StoreError(f"{path}: not {what} ({type(error).__name__}: {error}); {mend}") from error


def plain(value: object) -> Any:
    """Dataclasses, arrays, tuples and numbers as JSON values.

    Numbers that are not finite become text, 'nan', 'inf' or '-inf', since JSON has none for them; `built` reads it.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(name): plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def built(kind: type[T], held: Any, **given: Any) -> T:
    """A dataclass from what `plain` made of it, by the annotations of its fields; `given`: fields that stand elsewhere.

    ValueError where a field is missing or of another type; fields that the class does not have are left out.
    """
    if not isinstance(held, Mapping):
        raise ValueError(f"{kind.__name__}: {type(held).__name__} where an object belongs")
    values = dict(given)
    for name, hint in _hints(cast(Any, kind)).items():
        if name in values:
            continue
        if name not in held:
            raise ValueError(f"{kind.__name__} without '{name}'")
        try:
            values[name] = converted(hint, held[name])
        except (ValueError, TypeError) as error:
            raise ValueError(f"{name}: {error}") from None
    return kind(**values)


def converted(hint: Any, held: Any) -> Any:
    """A JSON value as the type of an annotation: text, numbers, bool, Literal, tuple, Mapping, array, dataclass, None.

    ValueError for a value of another type.
    """
    origin, arguments = get_origin(hint), get_args(hint)
    if hint is Any:
        return held
    if origin in (Union, types.UnionType):
        return _first(arguments, held)
    if origin is Literal:
        return _checked(held in arguments, held, " or ".join(map(repr, arguments)))
    if origin is tuple:
        _checked(isinstance(held, list), held, "a list")
        kinds = arguments[:1] * len(held) if arguments[-1] is Ellipsis else arguments
        _checked(len(kinds) == len(held), held, f"{len(kinds)} values")
        return tuple(converted(kind, each) for kind, each in zip(kinds, held, strict=True))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        _checked(isinstance(held, dict), held, "an object")
        return {name: converted(arguments[1], each) for name, each in held.items()}
    if hint is np.ndarray:
        return np.array(_checked(isinstance(held, list), held, "a list"), dtype=np.float64)  # 'nan' and 'inf' as well
    if hint is float:
        unlike = isinstance(held, bool) or (isinstance(held, str) and held not in ("nan", "inf", "-inf"))
        return float(_checked(not unlike and held is not None, held, "a number"))
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return built(hint, held)
    return _checked(type(held) is hint, held, "nothing" if hint is type(None) else hint.__name__)


def _first(kinds: tuple[Any, ...], held: Any) -> Any:
    """By the first of several types that takes the value."""
    for kind in kinds:
        try:
            return converted(kind, held)
        except (ValueError, TypeError) as error:
            reason = error
    raise reason


def _checked(right: bool, held: Any, wanted: str) -> Any:
    if not right:
        raise ValueError(f"{str(held)[:40]!r} where {wanted} belongs")
    return held


@cache
def _hints(kind: Any) -> dict[str, Any]:
    """The types of a dataclass's fields; annotations are text until somebody asks."""
    hints = get_type_hints(kind)
    return {field.name: hints[field.name] for field in dataclasses.fields(kind)}
