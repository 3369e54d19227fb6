"""The verdict on a stranger's shader: right ones are not accused, wrong ones fail, contract slips are told apart."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from harness.diagnosis.stranger import Judged, judge_stranger, reference, told
from harness.estimators.shader import LIMITS, Shader
from harness.samples.store import Store
from harness.scene import SceneFile
from harness.stats.verdicts import Tolerance
from harness.strangers.process import Process
from harness.work.run import Run
from tests.support.ball import BRIGHT, COSINE_TWICE, SCENE, body, toy
from tests.support.fakes import NoiseRenderer

# Enough for the verdicts of this scene. Frames are counted, not timed: a busy machine decides nothing.
SPP, FRAMES, TOLERANCE = 1024, 48, 0.005


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("ball")
    (path / "ball.xml").write_text(SCENE, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def process() -> Iterator[Process]:
    """One child that draws one shader after the other."""
    with Process(LIMITS) as process:
        yield process


def judged(folder: Path, text: str, name: str = "shader.frag", process: Process | None = None) -> Judged:
    """The verdict, its reference kept for the others; by a child of its own where there is no `process`."""
    (folder / name).write_text(text, encoding="utf-8")
    return judge_stranger(Shader((folder / name,)), SceneFile(folder / "ball.xml"), store=Store(folder / "store"),
                          frames=FRAMES, tolerance=TOLERANCE, spp=SPP, process=process)


@pytest.mark.parametrize(("text", "name"), [(body(), "right.frag"), (toy(), "right.glsl")])
def test_right_shaders_are_not_accused(folder: Path, process: Process, text: str, name: str) -> None:
    result = judged(folder, text, name, process)
    assert result.outcome != "fail", told(result)
    assert abs(result.slope - 1) < 0.02
    assert result.integrator == "path"


@pytest.mark.parametrize(("light", "sign"), [(BRIGHT, 1), (COSINE_TWICE, -1)])
def test_wrong_weights_fail_with_their_sign(folder: Path, process: Process, light: str, sign: int) -> None:
    result = judged(folder, body(light), process=process)
    assert result.outcome == "fail"
    assert sign * result.verdict.luminance[0] > 0
    assert result.transform == ""
    assert any(line.startswith("worst tile") for line in told(result))


@pytest.mark.parametrize(("text", "name", "says"), [
    (body(factor="3.14159265"), "pi.frag", "right but for a factor of π"),
    (body(side=-1.0), "mirrored.frag", "right but for left and right exchanged"),
    (toy(encoded="pow(s, vec3(1.0 / 2.2))"), "encoded.glsl", "each frame is encoded (x^(1/2.2))"),
])
def test_what_is_no_physics_is_told_apart(folder: Path, text: str, name: str, says: str,
                                          monkeypatch: pytest.MonkeyPatch) -> None:
    started, start = [], Process._start

    def counted(process: Process) -> None:
        started.append(process)
        start(process)

    monkeypatch.setattr(Process, "_start", counted)
    result = judged(folder, text, name)
    assert result.outcome == "fail"
    assert says in result.transform
    assert len(started) == 1  # one child draws all of it, decoded frames too


JITTER = "(pixel + vec2(rnd(), rnd()))"


def test_rays_through_the_pixels_centre_are_told_apart(folder: Path, process: Process) -> None:
    result = judged(folder, body().replace(JITTER, "(pixel + 0.0 * vec2(rnd(), rnd()) + 0.5)"), "centre.frag", process)
    assert result.outcome == "fail"
    assert result.transform == "the picture is right but for every ray through its pixel's centre (no antialiasing)"
    assert any(line.startswith("its edges are as of every ray through") for line in told(result))


def test_half_a_pixel_does_not_hide_what_is_wrong_besides(folder: Path, process: Process) -> None:
    """Both pictures that are compared for a cause have the shift, and differ by the cause alone."""
    result = judged(folder, body(BRIGHT).replace(JITTER, "(pixel + 0.5 + vec2(rnd(), rnd()))"), "shifted.frag",
                    process)
    assert result.outcome == "fail" and result.transform == ""
    assert result.view.spread is not None
    assert result.view.spread.defect.id == "half-pixel-up-right"
    found, truth = result.compared
    assert np.abs(found.mean - result.reference.mean).max() > 0.2  # along edges
    assert np.abs(found.mean / truth.mean - 1).max() < 0.1
    again = judge_stranger(Shader((folder / "shifted.frag",)), SceneFile(folder / "ball.xml"),
                           store=Store(folder / "store"), frames=FRAMES, tolerance=0.05, spp=SPP, view=result.view,
                           process=process)
    assert again.outcome != "fail", told(again)


def test_what_holds_no_radiance_is_left_out(folder: Path, process: Process) -> None:
    corner = toy().replace("1.0 / float(iFrame + 1)), 1.0);",
                           "1.0 / float(iFrame + 1)), 1.0); if (coord.x < 1.0 && coord.y < 1.0) color = vec4(9.0);")
    assert corner != toy()
    result = judged(folder, corner, "corner.glsl", process)
    assert result.outcome != "fail", told(result)


class TestReference:
    """Which of Mitsuba's integrators is believed."""

    @pytest.fixture
    def means(self, monkeypatch: pytest.MonkeyPatch) -> dict[str, float]:
        """Means of the integrators' pictures, which nobody renders."""
        means = {"path": 0.5, "bsdf_path": 0.5}

        def fake(scene: SceneFile, integrator: str, *others: object) -> Run:
            run = Run(NoiseRenderer(mean=means[integrator], sigma=0.1, size=(16, 16)), 256)
            run.grow(32)
            return run

        monkeypatch.setattr("harness.diagnosis.stranger._mitsuba", fake)
        return means

    def test_is_path_where_both_agree(self, folder: Path, means: dict[str, float]) -> None:
        held = reference(SceneFile(folder / "ball.xml"), Tolerance())
        assert (held.integrator, held.note) == ("path", "")

    def test_is_bsdf_path_where_path_leaks_light(self, folder: Path, means: dict[str, float]) -> None:
        means["path"] = 0.52
        held = reference(SceneFile(folder / "ball.xml"), Tolerance())
        assert held.integrator == "bsdf_path"
        assert "differ by +4.00%" in held.note and "path leaks light" in held.note
        assert held.run.estimate().image_mean[3] == pytest.approx(0.5, abs=0.01)

    def test_is_path_where_a_light_has_no_surface(self, folder: Path, means: dict[str, float]) -> None:
        means["bsdf_path"] = 0.1
        lit = SCENE.replace("<shape", '<emitter type="point"><rgb name="intensity" value="1, 1, 1"/></emitter>\n<shape')
        (folder / "lit.xml").write_text(lit, encoding="utf-8")
        held = reference(SceneFile(folder / "lit.xml"), Tolerance())
        assert held.integrator == "path"
        assert "a light that no path hits (point)" in held.note
