"""What an autopsy says of light sampling: which stage differs, and in which function; other ways are no error."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from harness.diagnosis.autopsy import diagnose, opened
from harness.diagnosis.case import Case
from harness.diagnosis.light_parts import BEHIND, wrong_light_parts
from harness.diagnosis.lights import NOTE, Oracle, leans, with_lights
from harness.diagnosis.record import AutopsyRecord
from harness.mutants.autopsy import as_own_files, wrong_functions
from harness.mutants.catalogue import choose, load_catalogue, mutated
from harness.mutants.variants import load_variants
from harness.reference.coupled_steps import CoupledSteps
from harness.scene import SceneFile
from harness.scene.strategies import parse_strategy
from harness.shader.library import OURS, Library, OwnFile

CATALOGUE = load_catalogue()
SCENE = SceneFile.bundled("cornell", (20, 20))
PARTS = tuple(dict.fromkeys(name for names in BEHIND.values() for name in names))


@dataclass(frozen=True, eq=False)
class Examined:
    """A case whose paths were found right, its record, and the oracle's samples."""

    case: Case
    paths: AutopsyRecord
    oracle: Oracle

    def lights(self, library: Library, strategy: str = "mis") -> AutopsyRecord:
        """What is said of a library whose paths are these as well."""
        return with_lights(self.paths, dataclasses.replace(self.case, library=library), parse_strategy(strategy),
                           self.oracle)


@pytest.fixture(scope="module")
def ours() -> Iterator[Examined]:
    with opened(CoupledSteps(SCENE), "mixture", OURS) as case:
        yield Examined(case, diagnose(case, 1), Oracle(SCENE))


def own(name: str) -> Library:
    """A correct variant, as its author would bring it."""
    return as_own_files(next(each for each in load_variants() if each.id == name))


def test_the_right_shader_is_acquitted(ours: Examined) -> None:
    found = ours.lights(OURS)
    assert not found.differs and NOTE not in found.notes and found.strategy == "mis"
    asked = {stage.stage: stage.asked for stage in found.stages}
    of_lights = ("chosen", "aimed", "light pdf", "least", "reflected", "bsdf pdf", "drawn pdf", "heuristic", "sent",
                 "met pdf", "light weight", "shadow", "weighed")
    assert all(asked[stage] > 100 for stage in of_lights) and asked["normal"] > 100


@pytest.mark.parametrize(("mutant", "stage"), [
    ("light-cosine-missing", "light pdf"), ("mis-light-weight-swapped", "light weight"),
    ("light-own-other-side", "shadow"),
])
def test_mutants_are_named_with_their_function(ours: Examined, mutant: str, stage: str) -> None:
    """One of each kind of stage: the first function named is the one that the line is in."""
    each, = choose(CATALOGUE, [mutant])
    found = ours.lights(mutated(each))
    assert found.stage == stage
    assert found.places[0].function in wrong_functions(each)
    assert found.path and found.where is not None


def test_the_loop_is_what_is_left_where_all_functions_are_right(ours: Examined) -> None:
    each, = choose(CATALOGUE, ["met-by-all-vertices"])
    found = ours.lights(mutated(each), "nee")
    assert found.stage == "lit paths" and found.places[0].function == "trace_samples"


@pytest.mark.parametrize(("mutant", "function"), [("ball-cone-cancels", "ball_cap"),
                                                  ("environment-draws-wide-caps", "sample_cap")])
def test_the_innermost_of_wrong_functions_is_the_first(mutant: str, function: str) -> None:
    """Those that call it are wrong as well."""
    each, = choose(CATALOGUE, [mutant])
    assert wrong_light_parts(mutated(each), PARTS)[0] == function


def test_no_function_of_ours_is_wrong() -> None:
    assert wrong_light_parts(OURS, PARTS) == []


def test_another_way_to_draw_is_no_error_and_a_wrong_one_is(ours: Examined) -> None:
    """Points of a rectangle by numbers in another order: as even, judged by the mean. With the light's cosine out of
    their density they are wrong, and what is named is the first stage that is not ours: the draw."""
    library = own("rectangle-from-another-corner")
    found = ours.lights(library, "nee")
    assert not found.differs and NOTE in found.notes
    file, = library.files
    line = "float pdf = height > 0.0 ? squared * distance / (area * height) : 0.0;"
    assert file.text.count(line) == 1
    wrong = OwnFile(file.name, file.text.replace(line, line.replace(" * distance", "").replace(" * height", "")),
                    file.shown)
    found = ours.lights(OURS.with_files(wrong), "nee")
    assert found.stage == "aimed" and "sample_rectangle" in [place.function for place in found.places]
    assert NOTE in found.notes


def test_what_samples_no_light_and_what_is_wrong_already_is_left_alone(ours: Examined) -> None:
    wrong = dataclasses.replace(ours.paths, stage="hit")
    assert with_lights(wrong, ours.case, parse_strategy("mis"), ours.oracle) is wrong
    assert ours.lights(OURS, "mixture") is ours.paths


def test_samples_that_part_either_way_do_not_lean() -> None:
    """As those of a mesh beside a displaced sphere's; a per cent less light does."""
    rng = np.random.default_rng(3)
    theirs = rng.exponential(size=(4, 20, 20, 3))
    others = rng.permutation(theirs.reshape(-1, 3)).reshape(theirs.shape)
    parted = np.where(rng.random((4, 20, 20, 1)) < 0.2, others, theirs)
    assert not leans(parted, theirs) and leans(0.99 * theirs, theirs)
    assert not leans(0.999 * theirs, theirs)
