"""The catalogue of causes: whole, and in step with the shader and with the catalogue of mutants."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.diagnosis.causes.catalogue import defective, known_lines, load_defects
from harness.errors import HarnessError
from harness.mutants.catalogue import load_catalogue
from harness.shader.library import OURS

DEFECTS = load_defects()
ENTRY = """
[[defect]]
id = "one"
says = "a"
family = "b"
formula = "c"
"""


def test_every_line_that_defects_are_written_into_is_in_the_shader_once() -> None:
    for file, line in known_lines().values():
        assert OURS.with_line(file, line, f"{line} // changed").digest != OURS.digest


def test_holds_what_the_field_calls_its_slips() -> None:
    assert len(DEFECTS) >= 60
    assert {"cosine-twice", "cosine-missing", "pdf-not-divided", "in-sphere-for-on-sphere", "one-bounce-less",
            "albedo-squared", "gamma-before-average", "lens-diameter"} <= {defect.id for defect in DEFECTS}


def test_names_mutants_that_there_are() -> None:
    assert {name for defect in DEFECTS for name in defect.same_as} <= {mutant.id for mutant in load_catalogue()}


def test_writes_a_defect_into_every_branch() -> None:
    cosine = next(defect for defect in DEFECTS if defect.id == "pdf-not-divided")
    assert [picture.strategy for picture in cosine.pictures] == ["uniform", "cosine", "mixture"]
    assert len({defective(picture) for picture in cosine.pictures}) == 3


def test_footprints_are_what_their_lines_draw() -> None:
    """The line for our tracer, drawn by numpy, has the mean and the spread that the reference is drawn with."""
    footprints = [defect for defect in DEFECTS if defect.footprint is not None]
    assert len(footprints) >= 7
    u, v = np.random.default_rng(5).random((2, 100_000))
    for defect in footprints:
        line = dict(defect.pictures[0].edits)["film"]
        place = line.partition("camera_ray((")[2].partition(") * pixel_size")[0].replace("vec2(pixel)", "0.0")
        place = place.replace("rand2()", "u").replace("vec2(rand() + rand(), rand() + rand())", "(u + v)")
        drawn = eval(place, {"u": u, "v": v}) + 0.0 * u  # numbers of our own file
        one = defect.footprint
        assert one is not None
        assert drawn.mean() == pytest.approx(0.5 + one.right, abs=0.005), defect.id
        assert drawn.mean() == pytest.approx(0.5 - one.down, abs=0.005), defect.id  # rows of GL's go up
        assert drawn.std() == pytest.approx(one.width / np.sqrt(24 if one.tent else 12), abs=0.005), defect.id


@pytest.mark.parametrize(("entry", "message"), [
    ("", "3: defect 'one' has neither an 'edit' nor"),
    ('edit = { weight = "x" }\nstrategy = "mixture"', "3: unknown key 'strategy' of a defect"),
    ('edit = { wait = "x" }', "3: unknown line 'wait'"),
    ('edit = { weight = 3 }', "3: the replacement of 'weight' must be a text"),
    ('edit = { direction = "d = drawn.l;" }', "3: the replacement of 'direction' must be a text, and another"),
    ('edit = { weight = "x" }\nstrategies = ["mis"]', "3: unknown strategy 'mis'"),
    (f'edit = {{ weight = "x" }}\n{ENTRY}edit = {{ weight = "x" }}', "the id 'one' is taken by"),
    (f'edit = {{ weight = "x" }}\n{ENTRY.replace("one", " ")}', "a defect needs 'id', a text that is not empty"),
    ('edit = { weight = "x" }\nfootprint = { height = 1.0 }', "3: a 'footprint' has width, right, down and tent"),
    ("edit = ", "not TOML"),
])
def test_says_where_a_file_is_malformed(tmp_path: Path, entry: str, message: str) -> None:
    (tmp_path / "a.toml").write_text(f"# first\n{ENTRY}{entry}\n", encoding="utf-8")
    with pytest.raises(HarnessError, match=r"a\.toml") as error:
        load_defects(tmp_path)
    assert message in str(error.value)


def test_says_that_a_folder_is_empty(tmp_path: Path) -> None:
    with pytest.raises(HarnessError, match="no defects there"):
        load_defects(tmp_path)
