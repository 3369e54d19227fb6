"""Hostile shaders: each is answered in one line, for what it is, and the next one is judged as if nothing had been."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from harness.errors import HarnessError
from harness.estimators.shader import Shader
from harness.gpu.frames import iterations_limit
from harness.strangers.experiment import experiment
from harness.strangers.process import Limits, Process
from tests.strangers.hostile import HOSTILE, SUM, Hostile, body, toy

SIZE = (16, 12)
# Those whose process has to go need not be waited for.
SHORT = Limits(first=1.0, least=0.5, memory=1 << 30, threads=1)


def sentences(hostile: Hostile, folder: Path, process: Process) -> list[str]:
    """What is said of it: the line of the error, or of each finding."""
    for name, content in hostile.files.items():
        (folder / name).write_bytes(content)
    try:
        contract = Shader((folder / next(iter(hostile.files)),)).read()
        found = experiment(contract, process, SIZE)
    except HarnessError as error:
        return [str(error)]
    return [f"{one.where}: {one.told}" if one.where else one.told for one in found.found]


@pytest.mark.parametrize("hostile", HOSTILE, ids=lambda hostile: hostile.name)
def test_is_named_for_what_it_is(hostile: Hostile, tmp_path: Path, process: Process) -> None:
    if hostile.unlimited and not iterations_limit():
        hostile = hostile.unlimited
    if hostile.lost:
        with Process(SHORT) as short:
            said = sentences(hostile, tmp_path, short)
    else:
        said = sentences(hostile, tmp_path, process)
    assert any(re.search(hostile.answer, sentence) for sentence in said) if hostile.answer else not said, said
    assert not any("\n" in sentence or "Traceback" in sentence for sentence in said)


RIGHT = (
    body("sum", "", SUM),
    body("several samples", "", "vec3 s = vec3(0.0); for (int i = 0; i < 4; ++i) s += vec3(rnd()); "
         "outBuffer0 = o + vec4(s, 4.0);"),
    toy("mean", ""),
    toy("count in alpha", "", "c = vec4((o.rgb * o.a + s) / (o.a + 1.0), o.a + 1.0);"),
    toy("first frame thrown away", "", "c = vec4(mix(o.rgb, s, 1.0 / max(n, 1.0)), 1.0);"),
    toy("rare and bright", "", sample="vec3(0.05) + (rnd() < 0.04 ? vec3(12.0) : vec3(0.0))"),
)


@pytest.mark.parametrize("right", RIGHT, ids=lambda right: right.name)
def test_right_shaders_are_not_accused(right: Hostile, tmp_path: Path, process: Process) -> None:
    assert sentences(right, tmp_path, process) == []


def test_are_forty_at_least() -> None:
    assert len({hostile.name for hostile in HOSTILE}) == len(HOSTILE) >= 40


def test_a_lost_process_does_not_harm_the_next_shader(tmp_path: Path) -> None:
    lost = next(hostile for hostile in HOSTILE if hostile.lost)
    good = body("good", "", SUM)
    with Process(SHORT) as process:
        assert sentences(lost, tmp_path, process)
        process.limits = Limits()
        assert sentences(good, tmp_path, process) == []
