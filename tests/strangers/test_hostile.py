"""Hostile shaders: each is answered in one line, for what it is, and the next one is judged as if nothing had been."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from harness.errors import HarnessError
from harness.estimators.shader import Shader
from harness.strangers.experiment import experiment
from harness.strangers.process import Limits, Process
from tests.strangers.hostile import HOSTILE, SUM, Hostile, body

SIZE = (16, 12)
# Those whose process has to go need not be waited for.
SHORT = Limits(first=2.0, least=1.0, memory=1 << 30, threads=1)


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
    if hostile.lost:
        with Process(SHORT) as short:
            said = sentences(hostile, tmp_path, short)
    else:
        said = sentences(hostile, tmp_path, process)
    assert any(re.search(hostile.answer, sentence) for sentence in said), said
    assert not any("\n" in sentence or "Traceback" in sentence for sentence in said)


def test_are_forty_at_least() -> None:
    assert len({hostile.name for hostile in HOSTILE}) == len(HOSTILE) >= 40


def test_a_lost_process_does_not_harm_the_next_shader(tmp_path: Path) -> None:
    lost = next(hostile for hostile in HOSTILE if hostile.lost)
    good = body("good", "", SUM)
    with Process(SHORT) as process:
        assert sentences(lost, tmp_path, process)
        process.limits = Limits()
        assert sentences(good, tmp_path, process) == []
