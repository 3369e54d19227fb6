"""What an autopsy says of light sampling: which of its stages differs, by whole samples beside the oracle's."""

from __future__ import annotations

import dataclasses

import pytest

from harness.diagnosis.lights import with_lights
from harness.diagnosis.record import AutopsyRecord
from harness.scene import SceneFile
from harness.scene.strategies import parse_strategy
from harness.shader.library import OURS

SIZE = (24, 24)
# An autopsy that found the paths right.
RIGHT = AutopsyRecord("cornell", "mixture", SIZE, 1, 576, None, (), {}, None, None, (), (), None, ())
CORNELL = SceneFile.bundled("cornell", SIZE)
DEFECTS = [
    ("lib/lights.glsl", "float pdf = height > 0.0 ? squared * distance / (area * height) : 0.0;",
     "float pdf = height > 0.0 ? squared / area : 0.0;", "light sampled", "towards"),
    ("lib/path.glsl", "#define OF_MET_LIGHT(pdf_of_lights) float(vertex == 1)",
     "#define OF_MET_LIGHT(pdf_of_lights) 1.0", "light counted", "trace_samples"),
    ("lib/mis.glsl", "return 1.0 / (1.0 + quotient);", "return quotient / (1.0 + quotient);", "light weighed",
     "mis_weight"),
]


def test_the_right_shader_is_acquitted() -> None:
    found = with_lights(RIGHT, CORNELL, parse_strategy("mis"), OURS)
    assert not found.differs
    assert [stage.stage for stage in found.stages] == ["light sampled", "light counted", "light weighed"]
    assert all(stage.asked == 4 * SIZE[0] * SIZE[1] for stage in found.stages)


@pytest.mark.parametrize(("file", "line", "replacement", "stage", "function"), DEFECTS,
                         ids=["sampled", "counted", "weighed"])
def test_the_stage_that_is_wrong_is_named(file: str, line: str, replacement: str, stage: str, function: str) -> None:
    """And the function that holds the line is among those it points to."""
    found = with_lights(RIGHT, CORNELL, parse_strategy("mis"), OURS.with_line(file, line, replacement))
    assert found.stage == stage
    assert function in [place.function for place in found.places]


def test_what_samples_no_light_and_what_is_wrong_already_is_left_alone() -> None:
    wrong = dataclasses.replace(RIGHT, stage="hit")
    assert with_lights(wrong, CORNELL, parse_strategy("mis"), OURS) is wrong
    assert with_lights(RIGHT, CORNELL, parse_strategy("mixture"), OURS) is RIGHT
    assert with_lights(RIGHT, SceneFile.bundled("diffuse", SIZE), parse_strategy("mis"), OURS) is RIGHT
