"""Parameters of a study: which a scene declares, the values that each is given, and all their combinations."""

from __future__ import annotations

import itertools
import re
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

from harness.errors import HarnessError, SceneError
from harness.estimators.base import Estimator, taken
from harness.scene import SceneFile

# Name and values of each parameter, in the order in which they were named.
Axes = tuple[tuple[str, tuple[str, ...]], ...]
# A parameter that stands in a scene file for what a property is.
_USED = re.compile(r"\$([A-Za-z_][A-Za-z0-9_]*)")
_COMMA = re.compile(r"(?<!\\),")
# Combinations that a study may have: each is rendered by Mitsuba and by every estimator.
MAX_COMBINATIONS = 10_000
# Names of a shader that a message lists.
MAX_LISTED = 12


def parse_axes(given: Sequence[str]) -> Axes:
    """`alpha=1,10,100` as a parameter and its values: commas part them, each is taken once.

    A value that holds several numbers has spaces between them, as Mitsuba takes it (`kd=1 0 0,0 1 0`: red, green); a
    comma of a value itself is written `\\,`. HarnessError for what is not NAME=VALUE,… and for a name given twice.
    """
    axes: dict[str, tuple[str, ...]] = {}
    for text in given:
        name, equals, values = text.partition("=")
        name = name.strip()
        if not (name and equals):
            raise HarnessError(f"--set: expected NAME=VALUE, or several with commas between, such as alpha=1,10,100; "
                               f"found '{text}'")
        if name in axes:
            raise HarnessError(f"--set: '{name}' is given twice; write all its values at once: "
                               f"{name}={','.join((*axes[name], values))}")
        found = [value.replace("\\,", ",").strip() for value in _COMMA.split(values)]
        if len(found) > 1 and not all(found):
            raise HarnessError(f"--set: '{text}' has an empty value between commas; leave it out")
        axes[name] = tuple(dict.fromkeys(found))
    return tuple(axes.items())


def axes_of(parameters: Mapping[str, object]) -> Axes:
    """The same from Python: a value, or several; text, numbers, or several numbers (a colour) for one value.

    HarnessError for a parameter without any value.
    """
    def text(value: object) -> str:
        return " ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)

    axes: dict[str, tuple[str, ...]] = {}
    for name, values in parameters.items():
        several = [values] if isinstance(values, str) or not isinstance(values, Iterable) else values
        axes[name] = tuple(dict.fromkeys(map(text, several)))
        if not axes[name]:
            raise HarnessError(f"parameter '{name}' has no value; give it one, or leave it out")
    return tuple(axes.items())


def combinations(scenes: Sequence[SceneFile], axes: Axes,
                 estimators: Sequence[str | Estimator] | None = None) -> tuple[SceneFile, ...]:
    """Every scene with every combination of values, the last parameter changing first; `parameters` of a scene itself
    stay.

    A name that the scene does not declare is set besides it (`SceneFile.besides`) where one of the `estimators` has it.
    SceneError where none has it either, HarnessError for scenes that cannot be told apart by their
    names, for a value of one number where the scene's own is several and a comma may have parted them, and for more
    than `MAX_COMBINATIONS`.
    """
    stems = [scene.path.stem for scene in scenes]
    if twice := next((stem for stem in stems if stems.count(stem) > 1), None):
        raise HarnessError(f"two of the scenes are called '{twice}'; a study tells them apart by their names: rename "
                           "one, or study them by themselves")
    count = len(scenes)
    for _, values in axes:
        count *= len(values)
    if count > MAX_COMBINATIONS:
        raise HarnessError(f"{count} combinations of scenes and parameters; at most {MAX_COMBINATIONS} are studied at "
                           "once")
    found = []
    for scene in scenes:
        own = _declared_of(scene.path, axes)
        several = [_at(scene, own, {name: value for (name, _), value in zip(axes, chosen, strict=True)})
                   for chosen in itertools.product(*(values for _, values in axes))]
        if several[0].besides:
            _require_taken(several[0], estimators or ())
        found += several
    return tuple(found)


def _at(scene: SceneFile, own: Container[str], values: Mapping[str, str]) -> SceneFile:
    inside, besides = ([pair for pair in values.items() if (pair[0] in own) is here] for here in (True, False))
    return replace(scene, parameters=(*scene.parameters, *inside), besides=(*scene.besides, *besides))


def declared(path: Path) -> dict[str, str]:
    """The parameters of a scene file and of what it includes: by name the value of its `<default>`; empty where it is
    used without one.

    Of a file that is no XML none; whoever parses the scene says so.
    """
    found: dict[str, str] = {}
    used: set[str] = set()
    for element in _elements(path, set()):
        if element.tag == "default":
            found.setdefault(element.get("name", ""), element.get("value", ""))
        for value in element.attrib.values():
            used.update(_USED.findall(value))
    return {**dict.fromkeys(sorted(used - found.keys()), ""), **found}


def number_of(value: str) -> float | None:
    """A parameter's value where it is one number."""
    try:
        return float(value)
    except ValueError:
        return None


def is_numeric(values: Sequence[str]) -> bool:
    """Whether all are numbers, so that they can stand on an axis."""
    return all(number_of(value) is not None for value in values)


def _require_taken(scene: SceneFile, estimators: Sequence[str | Estimator]) -> None:
    """SceneError for a value besides the scene that no estimator takes."""
    others = {each.name: taken(each, scene) for each in estimators if not isinstance(each, str)}
    for name, _ in scene.besides:
        if not any(name in names for names in others.values()):
            known = declared(scene.path)
            there = [f"it declares {', '.join(known)}" if known else "it declares none",
                     *(f"'{other}' has {_listed(names)}" for other, names in others.items() if names)]
            raise SceneError(f"{scene.path}: no parameter '{name}'; {'; '.join(there)}: write <default name=\"{name}\" "
                             f"value=\"…\"/> into the scene, and ${name} where its value belongs")


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
    return f"{', '.join(names[:MAX_LISTED])}{more}"


def _declared_of(path: Path, axes: Axes) -> Container[str]:
    """The names that a scene file declares; of one that is not there all, for whoever parses it says so."""
    if not path.is_file():
        return {name for name, _ in axes}
    known = declared(path) if axes else {}
    for name, values in axes:
        if name not in known:
            continue
        size = len(_numbers(known[name]))
        short = next((value for value in values if len(_numbers(value)) < size), None)
        if len(values) > 1 and size > 1 and short is not None:
            raise SceneError(f"{path}: parameter '{name}' is {size} numbers ('{known[name]}'), found '{short}': commas "
                             f"part values, so write spaces within one: --set '{name}={' '.join(['1'] * size)},"
                             f"{' '.join(['0'] * size)}'")
    return known


def _numbers(value: str) -> list[str]:
    return value.replace(",", " ").split()


def _elements(path: Path, seen: set[Path]) -> Iterator[ElementTree.Element]:
    if path.resolve() in seen:
        return
    seen.add(path.resolve())
    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, OSError, UnicodeDecodeError):
        return
    for element in root.iter():
        yield element
        name = element.get("filename")
        if element.tag == "include" and name and (path.parent / name).is_file():
            yield from _elements(path.parent / name, seen)
