"""Autopsies of the whole catalogue: does each name the function that the defect is in, and accuse no right shader?"""

from __future__ import annotations

import functools
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.diagnosis.autopsy import SAMPLES, diagnose, looks, opened
from harness.diagnosis.case import Case
from harness.diagnosis.lights import NOTE, Oracle, single, with_lights
from harness.diagnosis.record import AutopsyRecord
from harness.errors import StoreError
from harness.estimators.tracer import Tracer
from harness.files import data_dir, write_atomically
from harness.gpu.tap import Observed
from harness.mutants.catalogue import Mutant, mutated
from harness.mutants.variants import Variant, load_variants
from harness.progress import Progress, quiet
from harness.reference.coupled_steps import CoupledSteps
from harness.results import Acquitted, AutopsyOutcome, AutopsyScore, NamedMutant
from harness.samples.cost import Watch
from harness.scene import SceneFile
from harness.scene import load as read
from harness.scene.strategies import parse_strategy, suitable_strategies
from harness.shader.functions import functions_of
from harness.shader.library import GENERATED, OURS, Library, OwnFile
from harness.shader.scene.materials import switches
from harness.work.executors import executor

SIZE = (48, 36)
# Scenes with the strategies in which defects are looked for, in this order; together they compile every line.
SCENES: tuple[tuple[str, str], ...] = (
    ("spheres", "mixture"), ("spheres", "lobes"), ("spheres", "cosine"), ("spheres", "uniform"), ("diffuse", "cosine"),
    ("furnace_phong", "phong"), ("depth_of_field", "mixture"), ("environment", "mixture"), ("textures", "mixture"),
    ("motion_blur", "mixture"), ("transforms", "mixture"), ("cylinders", "mixture"), ("area_lights", "mixture"),
    ("procedural", "mixture"), ("course_scene", "mixture"), ("cornell", "mixture"), ("glossy_ladder", "lobes"),
    ("displaced", "mixture"), ("displaced_spheres", "mixture"), ("traps/seam", "mixture"), ("traps/ground", "mixture"),
    ("traps/grazing", "mixture"), ("traps/white_room", "mixture"), ("traps/far_camera", "mixture"),
    ("area_lights", "mis"), ("cornell", "nee"), ("environment", "mis"), ("cylinders", "nee"), ("many_lights", "mis"),
    ("displaced_spheres", "nee"), ("furnace_cube", "mis"), ("environment", "nee"), ("motion_blur", "mis"),
    ("displaced_spheres", "mis"), ("sun", "mis"), ("cornell", "mis"), ("textures", "nee"), ("area_lights", "nee"))
# Where a word of a mutant's id, or its file, is most at home: looked at first, which only saves time.
HOMES = {"lens": ("depth_of_field", "mixture"), "time": ("motion_blur", "mixture"),
         "motion": ("motion_blur", "mixture"), "cylinder": ("cylinders", "mixture"),
         "disk": ("area_lights", "mixture"), "only": ("furnace_phong", "phong"), "rectangle": ("cornell", "mixture"),
         "emission": ("area_lights", "mixture"), "emits": ("area_lights", "mixture"),
         "back": ("area_lights", "mixture"), "inside": ("cornell", "mixture"), "lobes": ("spheres", "lobes"),
         "uniform": ("spheres", "uniform"), "cosine": ("spheres", "cosine"), "wrapped": ("traps/seam", "mixture"),
         "draws": ("environment", "mis"), "grain": ("displaced_spheres", "mixture"),
         "fireflies": ("motion_blur", "mixture"),
         "clamped": ("cylinders", "mixture"), "lib/motion.glsl": ("motion_blur", "mixture"),
         "lib/displaced.glsl": ("displaced", "mixture"), "lib/bitmaps.glsl": ("textures", "mixture"),
         "lib/uv.glsl": ("textures", "mixture"), "lib/environment.glsl": ("environment", "mixture"),
         "lib/procedural.glsl": ("procedural", "mixture"), "lib/noise.glsl": ("procedural", "mixture")}
# The same of mutants of the topic LIGHTS, whose other words mean something else there.
LIGHTS = "lights"
LIT_HOMES = {"around": ("furnace_cube", "mis"), "march": ("displaced_spheres", "nee"), "sky": ("cylinders", "nee"),
             "map": ("environment", "mis"), "nee": ("cornell", "nee"), "vertices": ("cornell", "nee"),
             "vertex": ("cornell", "nee"), "rectangle": ("cornell", "mis")}
LIT_HOME = ("area_lights", "mis")
# Autopsies of one task, after which it asks for another.
CHUNK = 8


def score(mutants: Sequence[Mutant], *, jobs: int = 1, variants: bool = True,
          progress: Progress = quiet) -> AutopsyScore:
    """Examine every mutant until a scene shows it, and the right shader and its variants on every scene with
    every strategy that suits it, in `jobs` processes; a variant of the topic LIGHTS with those that sample them.

    HarnessError where a mutant or a variant does not apply.
    """
    for mutant in mutants:
        mutated(mutant)
    right = [(where, shaders) for where in _everywhere() if (shaders := _right(where[1]))] if variants else []
    found: dict[str, NamedMutant] = {}
    seen: dict[str, NamedMutant] = {}
    total = len(mutants) + sum(len(shaders) for _, shaders in right)
    with progress(total, "autopsies") as advance, executor("processes", jobs, _start) as pool:
        for results in pool.map(_examine, _at_home(mutants)):
            found |= {each.id: each for each in results if each.outcome in ("named", "misnamed")}
            seen |= {each.id: each for each in results}
            advance(len(results))
        waiting = [mutant for mutant in mutants if mutant.id not in found]
        for results in pool.map(_examine, list(_elsewhere(waiting))):
            for each in results:
                if each.outcome in ("named", "misnamed"):
                    found.setdefault(each.id, each)
                elif each.outcome == "missed" or each.id not in seen:
                    seen[each.id] = each
        acquitted: list[Acquitted] = []
        for cleared in pool.map(_acquit, right):
            acquitted += cleared
            advance(len(cleared))
    return AutopsyScore(tuple(found.get(mutant.id, seen[mutant.id]) for mutant in mutants), tuple(acquitted))


def _elsewhere(waiting: Sequence[Mutant]) -> Iterator[tuple[tuple[str, str], list[Mutant]]]:
    """Tasks: every scene, with the mutants that it may show; no strategy without them those of lights."""
    for where in SCENES:
        samples_lights = parse_strategy(where[1]).samples_lights
        if shown := [mutant for mutant in waiting if samples_lights or mutant.topic != LIGHTS]:
            yield where, shown


def _everywhere() -> Iterator[tuple[str, str]]:
    """Every scene that comes with the harness, traps included, with each strategy that suits it; one of those that draw
    alike where there is no lobe to choose."""
    folder = data_dir("mitsuba_scenes")
    for path in sorted([*folder.glob("*.xml"), *folder.glob("traps/*.xml")]):
        name = path.relative_to(folder).with_suffix("").as_posix()
        scene = read(SceneFile.bundled(name, SIZE))
        alike = () if switches(scene.shapes)["HAS_GLOSSY"] else ("lobes", "mixture")
        yield from ((name, strategy) for strategy in suitable_strategies(scene) if strategy not in alike)


def _right(strategy: str) -> list[tuple[str, Library]]:
    """Shaders that are right: ours, and the variants that a strategy is about."""
    about_lights = parse_strategy(strategy).samples_lights
    return [("ours", OURS), *((variant.id, as_own_files(variant)) for variant in load_variants()
                              if (variant.topic == LIGHTS) == about_lights)]


def as_own_files(variant: Variant) -> Library:
    """A variant as its author would bring it: files of his own in place of ours."""
    applied = variant.applied()
    files = dict.fromkeys(own.file for own in variant.exchanges)
    return OURS.with_files(*(OwnFile(file, dict(applied.assembled(file, {GENERATED: ""}).files)[file], file)
                             for file in files))


def _at_home(mutants: Sequence[Mutant]) -> list[tuple[tuple[str, str], list[Mutant]]]:
    """Tasks: a scene and the mutants that it is likeliest to show."""
    groups: dict[tuple[str, str], list[Mutant]] = {}
    for mutant in mutants:
        words = [*mutant.id.split("-"), mutant.file]
        homes, usual = (LIT_HOMES, LIT_HOME) if mutant.topic == LIGHTS else (HOMES, SCENES[0])
        groups.setdefault(next((homes[word] for word in words if word in homes), usual), []).append(mutant)
    return [(where, group[first:first + CHUNK]) for where, group in groups.items()
            for first in range(0, len(group), CHUNK)]


def wrong_functions(mutant: Mutant) -> tuple[str, ...]:
    """The function that a mutant's line is in; of a constant that a file defines, all functions that use it.

    From the text alone: the autopsy is not asked.
    """
    text = dict(OURS.assembled(mutant.file, {GENERATED: ""}).files)[mutant.file]
    line = next(number for number, each in enumerate(text.splitlines(), start=1) if each.strip() == mutant.line.strip())
    for function in functions_of(mutant.file, text):
        if function.line <= line <= function.last:
            return (function.name,)
    defined = re.search(r"#define\s+(\w+)|(\w+)\s*(?:=|;)", mutant.line)
    assert defined, "a line outside functions defines something"
    return _users(defined[1] or defined[2])


@functools.cache
def _users(name: str) -> tuple[str, ...]:
    """Functions that use a constant or a macro, of every scene of SCENES."""
    seen: set[str] = set()
    for scene, strategy in SCENES:
        source = OURS.tracer(read(SceneFile.bundled(scene, SIZE)), strategy)
        for file, content in source.files:
            for function in functions_of(file, content):
                if re.search(rf"\b{name}\b", function.text):
                    seen.add(function.name)
    return tuple(sorted(seen))


def _start() -> None:
    # As for the kill matrix: shaders are compiled far more often than they are drawn.
    os.environ.setdefault("GALLIVM_PERF", "nopt")


def _examine(task: tuple[tuple[str, str], Sequence[Mutant]]) -> list[NamedMutant]:
    """What the autopsy says of mutants on one scene."""
    (name, strategy), mutants = task
    right = _Right(CoupledSteps(SceneFile.bundled(name, SIZE)), strategy)
    return [right.examine(mutant) for mutant in mutants]


def _acquit(task: tuple[tuple[str, str], Sequence[tuple[str, Library]]]) -> list[Acquitted]:
    """What it says of right shaders there."""
    (name, strategy), right = task
    steps, how = CoupledSteps(SceneFile.bundled(name, SIZE)), parse_strategy(strategy)
    oracle, cleared = Oracle(steps.file), []
    for shader, library in right:
        with opened(steps, how.draw, library) as case:
            record = with_lights(diagnose(case), case, how, oracle)
            own = {*case.own, *([LIGHTS] if NOTE in record.notes else [])}
            cleared.append(Acquitted(shader, name, strategy, record.stage or "", tuple(sorted(own))))
    return cleared


class _Right:
    """The right shader's records on one scene, to tell which mutants change any."""

    def __init__(self, steps: CoupledSteps, strategy: str) -> None:
        self._steps, self._how = steps, parse_strategy(strategy)
        self._oracle = Oracle(steps.file)
        with opened(steps, self._how.draw, OURS) as case:
            self._case, self._records, self._record = case, _observe(case), diagnose(case)
        self._text, self._lit = (OURS.tracer(steps.reading, each).text for each in (self._how.draw, strategy))
        self._samples = single(Tracer(strategy), steps.file) if self._how.samples_lights else None

    def examine(self, mutant: Mutant) -> NamedMutant:
        """What the autopsy says of a mutant here; unreached where it changes no record and no sample."""
        library = mutated(mutant)
        unreached = NamedMutant(mutant.id, mutant.topic, mutant.file, wrong_functions(mutant), "unreached")
        path = mutant.file != "display.frag"
        if path and library.tracer(self._steps.reading, self._how.name).text == self._lit:
            return unreached
        if path and self._samples is not None:
            samples = single(Tracer(self._how.name, library=library), self._steps.file)
            if np.array_equal(samples, self._samples, equal_nan=True):
                return unreached
        watch = Watch()
        if path and library.tracer(self._steps.reading, self._how.draw).text == self._text:
            # The paths are ours, bit for bit: what is left are the lights.
            record = with_lights(self._record, replace(self._case, library=library), self._how, self._oracle)
            return _named(mutant, record, watch.cost("").seconds)
        with opened(self._steps, self._how.draw, library) as case:
            if path and self._samples is None and all(map(_same, _observe(case), self._records)):
                return unreached
            record = with_lights(diagnose(case), case, self._how, self._oracle)
        return _named(mutant, record, watch.cost("").seconds)


def _named(mutant: Mutant, record: AutopsyRecord, seconds: float) -> NamedMutant:
    wrong = wrong_functions(mutant)
    head = (mutant.id, mutant.topic, mutant.file, wrong)
    if record.stage is None:
        return NamedMutant(*head, "missed", record.scene, record.strategy)
    names = tuple(place.function for place in record.places)
    place = f"{record.places[0].file}:{record.places[0].line}" if record.places else ""
    stage = next(each for each in record.stages if each.stage == record.stage)
    outcome: AutopsyOutcome = "named" if names and names[0] in wrong else "misnamed"
    return NamedMutant(*head, outcome, record.scene, record.strategy, record.stage, names, place,
                       stage.first / record.paths, seconds)


def _observe(case: Case) -> list[Observed]:
    return [case.tap.observe(look) for look in looks(case, SAMPLES)]


def _same(one: Observed, other: Observed) -> bool:
    """Whether all records are, bit by bit."""
    pairs = [(one.accumulated, other.accumulated), *((one.paths[name], other.paths[name]) for name in one.paths)]
    for mine, theirs in zip(one.vertices, other.vertices, strict=True):
        pairs += [(mine[name], theirs[name]) for name in mine]
    return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


def save(found: AutopsyScore, path: Path) -> None:
    """Write the table as JSON, for the report. StoreError where it cannot be written."""
    with write_atomically(path) as partial:
        partial.write_text(json.dumps(as_json(found), indent=1) + "\n", encoding="utf-8")


def load(path: Path) -> AutopsyScore:
    """What `save` wrote; StoreError where the file is not that."""
    try:
        held = json.loads(path.read_text(encoding="utf-8"))
        return AutopsyScore(tuple(NamedMutant(**_tuples(each)) for each in held["mutants"]),
                            tuple(Acquitted(**_tuples(each)) for each in held["variants"]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise StoreError(f"{path}: not a table of autopsies ({type(error).__name__}: {error}); run `harness mutants "
                         "--autopsy` again") from None


def as_json(found: AutopsyScore) -> Mapping[str, object]:
    """The table as JSON types."""
    return asdict(found)


def _tuples(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}
