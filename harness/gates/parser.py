"""From a TOML file to gates: every key typed and checked, and whatever is wrong refused with file and line.

A file has tables [suite] (false_alarms), [defaults] (any key of a gate but name, scene and reason), [coupled] (the
same, for gates whose reference is coupled) and, for each gate or for several strategies of one, [[gate]]:

    name         a folder's name; of a list of strategies each is called NAME-STRATEGY
    scene        a Mitsuba scene file (.xml), or the name of one that is bundled with the harness
    strategy     one, or a list; or in its place
    command      a program that renders the scene: "myrt {scene} --spp {spp} --seed {seed} -o {out}" ({max_depth}
                 hands a depth on); or
    images       renders that are there: a file, a folder or a pattern such as "mine_*.exr", each an independent run
    sampler      where the tracer's random numbers come from, independent or sobol
    reason       why this tolerance; reports quote it
    tolerance    { mean, coarse, fine }: relative bias of the image, of larger and of smaller tiles that counts as none
    spp          samples per pixel of a replica
    replicas     the most that are drawn; with spp the budget
    size         [width, height], the film's own if not given
    max_depth    vertices of a path at most, of the test and of Mitsuba's reference; the scene's own if not given
    reference    { spp } of Mitsuba for each replica, { file } (.exr), { value } (one colour for all pixels), or
                 { coupled = true }: Mitsuba on the very paths of the strategy, by its own random numbers. Beside spp,
                 sampler: one of Mitsuba's, such as "multijitter", which spreads the samples of each replica evenly
    agreement    of coupled gates: the share of samples that may differ by more than 0.1 % of themselves
    confidence   of the intervals that must lie within the tolerance
    not_finite   the share of samples that may be neither finite nor counted
    timeout      seconds that a run of the command may take
    shader       a file that stands in for path_tracer.frag
    glsl         a folder of files that stand in for those of the harness's glsl/ with the same name

Paths are relative to the file.
"""

from __future__ import annotations

import dataclasses
import math
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from harness.errors import HarnessError
from harness.estimators.base import Estimator
from harness.estimators.command import TIME_LIMIT, Command
from harness.estimators.constant import Constant
from harness.estimators.coupled import Coupled
from harness.estimators.images import Images
from harness.estimators.mitsuba import Mitsuba
from harness.estimators.tracer import Tracer
from harness.gates.lines import Lines, Way, lines
from harness.gates.model import (
    LOOK_SHARES,
    MAX_REPLICAS,
    MAX_SIDE,
    MAX_TILE,
    MIN_REPLICAS,
    Gate,
    GatesFile,
)
from harness.reference.prepare import INDEPENDENT
from harness.scene.file import MAX_DEPTH_LIMIT, SceneFile
from harness.scene.sensors import SAMPLERS
from harness.scene.strategies import parse_strategy
from harness.shader.samplers import DEFAULT, sampler_named
from harness.stats.agreement import SHARE
from harness.stats.levels import family_level
from harness.stats.paired import COUPLED, check_paired_tolerance
from harness.stats.verdicts import Tolerance

# What a gate has that neither it nor the file's [defaults] mention.
DEFAULTS: dict[str, Any] = {"spp": 32, "replicas": 64, "reference": {"spp": 32}, "confidence": 0.95, "not_finite": 0.0}
COUPLED_DEFAULTS: dict[str, Any] = DEFAULTS | {"spp": 64, "tolerance": dataclasses.asdict(COUPLED), "agreement": SHARE}
# The whole file raises a false alarm with at most this probability, unless its [suite] says otherwise.
FALSE_ALARMS = 0.01
MAX_SPP = 1 << 16  # of one replica

_GATE_KEYS = ("name", "scene", "strategy", "reason", "tolerance", "spp", "replicas", "size", "max_depth", "reference",
              "confidence", "not_finite", "agreement", "command", "images", "timeout", "shader", "glsl", "sampler")
# Of which a gate has one: what it judges.
_JUDGED = ("strategy", "command", "images")
_OWN_KEYS = ("name", "scene", "reason")  # which have no default
_FOLDER_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


def load_gates(path: str | Path) -> GatesFile:
    """Read a gates file. HarnessError, in one line with file and line, for anything that no gate can be made of."""
    path = Path(path)
    root = _Table(path, *_parse(path), ())
    root.only("suite", "defaults", "coupled", "gate")
    suite = root.table("suite")
    suite.only("false_alarms")
    false_alarms = suite.number("false_alarms", FALSE_ALARMS, low=0.0, high=0.5)
    defaults = root.table("defaults")
    defaults.only(*(key for key in _GATE_KEYS if key not in _OWN_KEYS))
    coupled = root.table("coupled")
    coupled.only(*(key for key in _GATE_KEYS if key not in _OWN_KEYS))
    gates = [gate for entry in root.tables("gate") for gate in _gates(entry, defaults, coupled)]
    if not gates:
        raise HarnessError(f"{path}:1: no gate in this file; add a [[gate]] with name, scene, strategy and reason")
    seen: dict[str, Gate] = {}
    for gate in gates:
        if gate.name in seen:
            raise gate.error(f"the name is taken by {seen[gate.name].origin}; choose another")
        seen[gate.name] = gate
    level = family_level(false_alarms, len(gates))
    return GatesFile(path, tuple(dataclasses.replace(gate, fail_level=level) for gate in gates), false_alarms)


def _parse(path: Path) -> tuple[dict[str, Any], Lines]:
    try:
        text = path.read_text(encoding="utf-8-sig")  # editors on Windows begin files with a byte-order mark
    except IsADirectoryError:
        raise HarnessError(f"{path}: a folder, not a gates file; name a .toml file") from None
    except OSError as error:
        raise HarnessError(f"{path}: the gates file cannot be read ({error.strerror}); name a .toml file") from None
    except ValueError:
        raise HarnessError(f"{path}: not UTF-8 text; save the file in the encoding UTF-8") from None
    try:
        return tomllib.loads(text), lines(text)
    except tomllib.TOMLDecodeError as error:
        message = str(error)
        found = re.search(r"\(at line (\d+), column \d+\)", message)
        line = found[1] if found else len(text.splitlines()) or 1  # "(at end of document)"
        raise HarnessError(f"{path}:{line}: malformed TOML: {message.partition(' (at')[0]}") from None


def _gates(entry: _Table, defaults: _Table, coupled: _Table) -> Iterator[Gate]:
    """The gates of one entry: one for each strategy, with its name appended where there is a list of them."""
    entry.only(*_GATE_KEYS)
    name = entry.text("name")
    if not _FOLDER_NAME.fullmatch(name):
        raise entry.error("name", f"a gate's name becomes that of a folder: letters, digits, '.', '_' and '-', found "
                                  f"'{name}'")
    reason = entry.text("reason")
    path = _scene(entry)
    follows = _is_coupled(entry)
    merged = entry.over(coupled if follows else defaults, COUPLED_DEFAULTS if follows else DEFAULTS)
    depth = merged.integer("max_depth", 1, MAX_DEPTH_LIMIT) if "max_depth" in merged.values else None
    scene = SceneFile(path, size=_size(merged), max_depth=depth)
    if not follows and "agreement" in entry.values:
        raise entry.error("agreement", "'agreement' is of gates with reference = { coupled = true }; others draw "
                                       "numbers of their own, and no sample has a twin")
    for label, test in _judged(merged, scene):
        reference, reference_spp = _reference(merged, test)
        files = len(test.files) if isinstance(test, Images) else 0
        yield Gate(
            name=f"{name}-{label}" if label else name, entry=name, scene=scene, reason=reason, test=test,
            reference=reference, reference_spp=reference_spp, tolerance=_tolerance(merged),
            spp=merged.integer("spp", 1, MAX_SPP), replicas=files or _replicas(merged), at_once=bool(files),
            fail_level=FALSE_ALARMS, pass_level=1 - merged.number("confidence", low=0.5, high=1.0),
            not_finite=merged.number("not_finite", low=0.0, high=1.0, or_low=True), origin=entry.origin(),
            agreement=merged.number("agreement", SHARE, low=0.0, high=1.0) if follows else None)


def _is_coupled(entry: _Table) -> bool:
    reference = entry.values.get("reference")
    return isinstance(reference, dict) and "coupled" in reference


def _judged(table: _Table, scene: SceneFile) -> Iterator[tuple[str, Estimator]]:
    """What a gate judges, each with what is added to the gate's name: nothing where there is one."""
    given = [key for key in _JUDGED if key in table.values and table.is_own(key)] or [
        key for key in _JUDGED if key in table.values]
    if len(given) != 1:
        raise table.error(given[-1] if given else "strategy",
                          f"expected one of {', '.join(_JUDGED)}, found {' and '.join(given) or 'none of them'}")
    if given != ["strategy"]:
        for key in ("shader", "glsl", "sampler"):
            if key in table.values and table.is_own(key):
                raise table.error(key, f"'{key}' is part of our tracer, and '{given[0]}' stands in its place; take one "
                                       "of them away")
        try:
            if given == ["images"]:
                yield "", _runs(table)
            else:
                seconds = table.number("timeout", TIME_LIMIT, low=0.0, high=86_400.0)
                command = Command(table.text("command"), seconds)
                command.check(scene)
                yield "", command
        except HarnessError as error:
            raise error if str(error).startswith(f"{table.path}:") else table.error(given[0], str(error)) from None
        return
    listed = isinstance(table.value("strategy"), list)
    for strategy in _strategies(table):
        yield strategy if listed else "", Tracer(strategy, shader=table.file("shader"),
                                                 folder=table.file("glsl", folder=True), sampler=_own_sampler(table))


def _runs(table: _Table) -> Images:
    """The images that are judged: two or more, for one tells nothing of its noise."""
    images = Images.found(table.text("images"), table.path.parent)
    if not 1 < len(images.files) <= MAX_REPLICAS:
        raise table.error("images", f"'{table.text('images')}' names {len(images.files)} file(s), expected 2 to "
                                    f"{MAX_REPLICAS} independent runs; render the scene again with other seeds")
    return images


def _scene(entry: _Table) -> Path:
    """A file beside the gates file, or the name of a bundled scene."""
    named = entry.text("scene")
    if named.endswith(".xml"):
        return entry.existing("scene", named)
    try:
        return SceneFile.bundled(named).path
    except HarnessError as error:
        raise entry.error("scene", str(error)) from None


def _strategies(table: _Table) -> tuple[str, ...]:
    named = table.value("strategy")
    names = named if isinstance(named, list) else [named]
    for name in names:
        try:
            parse_strategy(name)
        except HarnessError as error:
            raise table.error("strategy", str(error)) from None
    if not names or len(set(names)) < len(names):
        raise table.error("strategy", f"expected one or more strategies, each once, found {named}")
    return tuple(names)


def _own_sampler(table: _Table) -> str:
    named = table.text("sampler") if "sampler" in table.values else DEFAULT
    try:
        return sampler_named(named).name
    except HarnessError as error:
        raise table.error("sampler", str(error)) from None


def _tolerance(table: _Table) -> Tolerance:
    given = table.table("tolerance")
    given.only("mean", "coarse", "fine")
    standard = Tolerance()
    mean, coarse, fine = (given.number(key, getattr(standard, key), low=0.0, high=high, or_high=True)
                          for key, high in (("mean", 1.0), ("coarse", MAX_TILE), ("fine", MAX_TILE)))
    for key, value, wider, bound in (("coarse", coarse, "mean", mean), ("fine", fine, "coarse", coarse)):
        if value < bound:
            raise given.error(key if key in given.values else wider,
                              f"contradictory tolerances: '{key}' ({value:g}), of a part of the image, is below "
                              f"'{wider}' ({bound:g}), of more of it; a part is the harder to see: give it as much")
    return Tolerance(mean, coarse, fine)


def _replicas(table: _Table) -> int:
    replicas = table.integer("replicas", 1, MAX_REPLICAS)
    if replicas < MIN_REPLICAS:
        raise table.error("replicas", f"a budget of {replicas} replicas is too small to decide: the first look, at a "
                                      f"{LOOK_SHARES[0]}th of it, must tell its own variance; {MIN_REPLICAS} would do "
                                      "('spp' may be made smaller instead)")
    if replicas % LOOK_SHARES[0]:
        raise table.error("replicas", f"must be a multiple of {LOOK_SHARES[0]}, found {replicas}")
    return replicas


def _size(table: _Table) -> tuple[int, int] | None:
    if "size" not in table.values:
        return None
    found = table.values["size"]
    if not (isinstance(found, list) and len(found) == 2 and all(type(n) is int and 1 <= n <= MAX_SIDE for n in found)):
        raise table.error("size", f"expected [width, height], each 1 to {MAX_SIDE}, found {found}")
    return found[0], found[1]


def _reference(table: _Table, test: Estimator) -> tuple[Estimator, int]:
    """What a gate is held against, and its samples per pixel for each replica of the test."""
    given = table.table("reference")
    given.only("spp", "sampler", "file", "value", "coupled")
    kinds = given.values.keys() - {"sampler"}
    if len(kinds) != 1 or (kinds != {"spp"} and "sampler" in given.values):
        raise table.error("reference", 'expected one of { spp = 32 }, { file = "truth.exr" }, { value = [1, 1, 1] }, '
                                       f"{{ coupled = true }}, found {len(given.values)} keys")
    if "coupled" in given.values:
        return _coupled(table, given, test), table.integer("spp", 1, MAX_SPP)
    if "spp" in given.values:
        return Mitsuba(sampler=_sampler(given)), given.integer("spp", 1, MAX_SPP)
    if "file" in given.values:
        return Images((given.existing("file", given.text("file")),)), 1
    value = given.values["value"]
    if not (isinstance(value, list) and len(value) == 3 and all(_is_number(v) and v >= 0 for v in value)):
        raise given.error("value", f"expected [red, green, blue], each zero or more, found {value}")
    return Constant((float(value[0]), float(value[1]), float(value[2]))), 1


def _sampler(given: _Table) -> str:
    """Whichever: verdicts go by replicas, which are independent of each other with all of them."""
    if "sampler" not in given.values:
        return INDEPENDENT
    name = given.text("sampler")
    if name not in SAMPLERS:
        raise given.error("sampler", f"Mitsuba has no sampler '{name}'; choose from {', '.join(SAMPLERS)}")
    return name


def _coupled(table: _Table, given: _Table, test: Estimator) -> Coupled:
    """The oracle on the test's own paths, where it has any that can be followed."""
    if given.values["coupled"] is not True:
        raise given.error("coupled", f"expected true, found {given.values['coupled']!r}")
    plain = "hold it against reference = { spp = 32 } instead"
    if not isinstance(test, Tracer):
        raise table.error("reference", f"only our tracer's paths can be followed, and what is judged is {test.name}; "
                                       f"{plain}")
    if test.shader is not None and not re.search(r'#\s*include\s*"lib/path\.glsl"', test.shader.read_text("utf-8")):
        raise table.error("shader", f"{test.shader} traces paths of its own (it does not include lib/path.glsl), which "
                                    f"cannot be followed; {plain}")
    try:
        check_paired_tolerance(_tolerance(table))
    except HarnessError as error:
        if str(error).startswith(f"{table.path}:"):
            raise
        raise table.error("tolerance", str(error)) from None
    return Coupled(test.strategy, test.sampler)


class _Table:
    """One table of the file: its values taken by type, what is wrong said with file and line."""

    def __init__(self, path: Path, values: dict[str, Any], places: Lines, way: Way) -> None:
        self.path, self.values, self.places, self.way = path, values, places, way
        self._elsewhere: dict[str, Way] = {}  # of keys that come from another table, that table's way

    def error(self, key: str, message: str) -> HarnessError:
        """A message about a key, which points to where it stands; to [defaults] if it comes from there."""
        return HarnessError(f"{self.path}:{self.places.line(*self._way(key))}: {message}")

    def origin(self) -> str:
        return f"{self.path}:{self.places.line(*self.way)}"

    def over(self, defaults: _Table, standard: dict[str, Any]) -> _Table:
        """This table's values, and those of `defaults` and `standard` where it has none; tolerances one by one."""
        values = {**standard, **defaults.values, **self.values}
        given = [table["tolerance"] for table in (standard, defaults.values, self.values) if "tolerance" in table]
        if given and all(isinstance(tolerance, dict) for tolerance in given):
            values["tolerance"] = {key: value for tolerance in given for key, value in tolerance.items()}
        merged = _Table(self.path, values, self.places, self.way)
        merged._elsewhere = {key: defaults.way for key in defaults.values if key not in self.values}
        return merged

    def is_own(self, key: str) -> bool:
        """It stands in this table, and not in [defaults]."""
        return key not in self._elsewhere

    def only(self, *known: str) -> None:
        for key in self.values:
            if key not in known:
                raise self.error(key, f"unknown key '{key}'; allowed: {', '.join(known)}")

    def value(self, key: str) -> Any:
        if key not in self.values:
            raise self.error(key, f"'{key}' is missing")
        return self.values[key]

    def text(self, key: str) -> str:
        found = self.value(key)
        if not isinstance(found, str) or not found.strip():
            raise self.error(key, f"'{key}' must be a text, found {found!r}")
        return found

    def number(self, key: str, default: float | None = None, *, low: float, high: float, or_low: bool = False,
               or_high: bool = False) -> float:
        """A number between `low` and `high`, the bounds themselves excluded unless `or_low`, `or_high`."""
        found = self.value(key) if default is None else self.values.get(key, default)
        allowed = _is_number(found) and low <= found <= high
        if not allowed or (found == low and not or_low) or (found == high and not or_high):
            raise self.error(key, f"'{key}' must be a number {'from' if or_low else 'above'} {low:g} "
                                  f"{'up to' if or_high else 'and below'} {high:g}, found {found!r}")
        return float(found)

    def integer(self, key: str, low: int, high: int) -> int:
        found = self.value(key)
        if type(found) is not int or not low <= found <= high:
            raise self.error(key, f"'{key}' must be a whole number from {low} to {high}, found {found!r}")
        return found

    def file(self, key: str, *, folder: bool = False) -> Path | None:
        return self.existing(key, self.text(key), folder=folder) if key in self.values else None

    def existing(self, key: str, named: str, *, folder: bool = False) -> Path:
        """The path of a file, or folder, that is named relative to the gates file."""
        path = self.path.parent / named
        if not (path.is_dir() if folder else path.is_file()):
            raise self.error(key, f"no such {'folder' if folder else 'file'}: '{named}'; paths are relative to "
                                  f"{self.path.name}")
        return path

    def table(self, key: str) -> _Table:
        found = self.values.get(key, {})
        if not isinstance(found, dict):
            raise self.error(key, f"'{key}' must be a table, found {found!r}")
        return _Table(self.path, found, self.places, self._way(key))

    def tables(self, key: str) -> list[_Table]:
        found = self.values.get(key, [])
        if not isinstance(found, list) or not all(isinstance(item, dict) for item in found):
            raise self.error(key, f"'{key}' must be an array of tables: begin each with [[{key}]]")
        return [_Table(self.path, item, self.places, (*self.way, key, k)) for k, item in enumerate(found)]

    def _way(self, key: str) -> Way:
        return (*self._elsewhere.get(key, self.way), key)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
