"""`harness render --watch --tev`: a whole session, from the first image to Ctrl-C."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.files import data_dir
from harness.samples.exr import read_estimate
from harness.view.saved import Saved
from tests.cli.conftest import Harness, refusal
from tests.support.tev import CREATE, listening

User = Callable[..., None]


@pytest.fixture
def user(monkeypatch: pytest.MonkeyPatch) -> User:
    """What a user does each time that the harness waits: each step saves something; then Ctrl-C."""
    def ctrl_c() -> None:
        raise KeyboardInterrupt

    def does(*steps: Callable[[], object]) -> None:
        coming = iter(steps)

        def waited(saved: Saved) -> None:
            next(coming, ctrl_c)()
            assert saved._told.wait(60), "the save was not noticed"

        monkeypatch.setattr(Saved, "wait", waited)
    return does


def test_scene_include_and_shader_are_watched_until_ctrl_c(
    harness: Harness, user: User, sky: Path, tmp_path: Path,
) -> None:
    """Radiance 0.5 of the sky becomes 2 of an include; a file that is broken for a moment is one line."""
    library = tmp_path / "mine"
    (library / "lib").mkdir(parents=True)
    shutil.copy(data_dir("glsl") / "lib" / "phong.glsl", library / "lib")
    light = tmp_path / "light.xml"
    light.write_text('<scene version="3.0.0"><emitter type="constant"><rgb name="radiance" value="2, 2, 2"/></emitter>'
                     "</scene>")
    before = sky.read_text()
    included = before[:before.index("<emitter")] + '<include filename="light.xml"/></scene>'
    seen: list[float] = []

    def look() -> None:
        seen.append(float(read_estimate("x.exr")[0].mean[0, 0, 0]))

    def then(step: Callable[[], object]) -> Callable[[], None]:
        def both() -> None:
            look()
            step()
        return both

    shader = library / "lib" / "phong.glsl"
    good = shader.read_text()
    user(then(lambda: sky.write_text("<scene")), then(lambda: sky.write_text(included)),
         then(lambda: light.write_text(light.read_text().replace("2, 2, 2", "4, 4, 4"))),
         then(lambda: shader.write_text(good + "oops\n")), then(lambda: shader.write_text(good)))
    done = harness("render", sky, "--spp", 2, "--library", library, "--watch", "-o", "x.exr")
    assert done.status == 130
    look()
    assert seen == [0.5, 0.5, 2.0, 4.0, 4.0, 4.0]
    errors = [line for line in done.err.splitlines() if line.startswith("harness: error: ")]
    assert len(errors) == 2
    assert errors[0].startswith(f"harness: error: {sky}:1: ")
    assert errors[1].startswith(f"harness: error: {shader}:")
    assert done.err.endswith("harness: interrupted\n")
    assert done.out.count("x.exr: 16 x 12, 2 spp") == 4


def test_tev_sees_the_image_grow(harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("harness.cli.render.TEV_SECONDS", -1.0)
    scene = data_dir("mitsuba_scenes") / "spheres.xml"
    with listening() as fake:
        done = harness("render", scene, "--size", "16x12", "--spp", 8, "--tev", "--tev-at", fake.address, "-o", "x.exr")
    assert done.status == 0
    assert fake.packets[0] == (CREATE, "spheres mixture")
    assert len(fake.history) == 4, "after 1, 2, 4 and 8 samples"
    np.testing.assert_allclose(fake.history[-1], read_estimate("x.exr")[0].mean, rtol=1e-6)
    assert (fake.history[0] != fake.history[-1]).any()


def test_an_image_outlives_the_tev_that_shows_it(
    harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    def gone(*arguments: object) -> None:
        raise HarnessError("tev went away")

    monkeypatch.setattr("harness.view.tev.Tev.show", gone)
    with listening() as fake:
        done = harness("render", sky, "--spp", 4, "--tev-at", fake.address, "-o", "x.exr")
    assert done.status == 0
    assert done.err.count("warning: tev went away") == 1
    assert read_estimate("x.exr")[0].samples == 4


def test_what_cannot_be_is_refused(harness: Harness, sky: Path, tmp_path: Path) -> None:
    assert "--watch does not end by itself" in refusal(harness("render", sky, "--watch", "--json"))
    assert "no such scene file" in refusal(harness("render", tmp_path / "none.xml", "--watch"))
    assert "is not a folder" in refusal(harness("render", sky, "--library", tmp_path / "none"))
    done = harness("render", sky, "--tev-at", "localhost:1")
    assert done.status == 3
    assert done.err.startswith("harness: error: no tev answers at localhost:1 (Connection refused); start tev first")
