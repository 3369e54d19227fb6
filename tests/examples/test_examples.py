"""Renderers that know nothing of the harness, judged by it: fifty lines of NumPy, and Mitsuba's own command line."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from harness.estimators.command import Command
from harness.estimators.mitsuba import Mitsuba
from harness.policy import judge
from harness.samples.estimate import Estimate
from harness.scene import SceneFile
from harness.work.run import run_of

HERE = Path(__file__).parent
BALL = SceneFile(HERE / "ball.xml", size=(32, 24))
# Of the mean: what so few samples decide.
TOLERANCE = 0.01
SPP = 16


def numpy_tracer(folder: Path, old: str = "", new: str = "") -> Command:
    """The example, or with something else in its text."""
    text = (HERE / "numpy_tracer.py").read_text(encoding="utf-8")
    assert text.count(old) == 1 or not old
    (folder / "tracer.py").write_text(text.replace(old, new) if old else text, encoding="utf-8")
    return Command(f"{sys.executable} {folder / 'tracer.py'} {{out}} {{seed}} {{spp}} {{width}} {{height}}")


def drawn(estimator: Command | Mitsuba, replicas: int, spp: int, scene: SceneFile = BALL) -> Estimate:
    with estimator.open(scene) as renderer:
        run = run_of(renderer, spp)
        run.grow(replicas)
        return run.estimate()


@pytest.fixture(scope="module")
def truth() -> Estimate:
    return drawn(Mitsuba(), 16, 64)


def test_the_example_renders_its_scene(tmp_path: Path, truth: Estimate) -> None:
    verdict = judge(drawn(numpy_tracer(tmp_path), 8, SPP), truth, tolerance=TOLERANCE)
    assert verdict.outcome == "pass", verdict.reason


@pytest.mark.parametrize(("right", "wrong"), [
    ("mask * SKY, 0)", "SKY, 0)"), ("np.array([0.0, 1.0, 6.0])", "np.array([0.0, 1.0, 5.5])"),
    ("mask * ALBEDO[which])", "mask * ALBEDO[which] * 0.97)")])
def test_an_error_in_it_is_found(tmp_path: Path, truth: Estimate, right: str, wrong: str) -> None:
    """Light without throughput, an eye that is too near, an albedo that is too dark."""
    verdict = judge(drawn(numpy_tracer(tmp_path, right, wrong), 8, SPP), truth, tolerance=TOLERANCE)
    assert verdict.outcome == "fail"


def test_mitsubas_own_command_line_agrees_with_another_integrator(truth: Estimate) -> None:
    program = shutil.which("mitsuba", path=str(Path(sys.executable).parent))
    assert program, "the package mitsuba brings its command"
    command = Command(f"{program} -m scalar_rgb -D spp={{spp}} -D seed={{seed}} -D integrator={{integrator}} "
                      "-D width={width} -D height={height} {scene} -o {out}")
    scene = SceneFile(HERE / "ball.xml", (("integrator", "volpath"), ("width", "32"), ("height", "24")))
    found = drawn(command, 8, 64, scene)
    assert found.mean.shape == (24, 32, 3) and np.isfinite(found.mean).all()
    verdict = judge(found, truth, tolerance=TOLERANCE)
    assert verdict.outcome == "pass", verdict.reason
