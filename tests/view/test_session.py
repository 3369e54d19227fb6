"""What keys do to the image that is watched, and that it is the image that is drawn without a window."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from harness.estimators.tracer import Tracer
from harness.gpu.display import display
from harness.samples.estimate import Estimate
from harness.samples.exr import read_estimate
from harness.scene import SceneFile
from harness.view.loop import watch
from harness.view.session import Session, Watched
from tests.support.fakes import NoiseRenderer

SCENE = SceneFile.bundled("furnace_cube", (16, 12))  # of depth 8


@dataclass(frozen=True)
class Noise:
    """An estimator of a known mean; `opened` notes the depths at which it was."""

    name: str = "noise"
    mean: float = 0.5
    opened: list[int | None] = field(default_factory=list, compare=False)

    def check(self, scene: SceneFile) -> str:
        return ""

    def takes_depth(self, scene: SceneFile) -> str:
        return "" if self.name == "noise" else f"{self.name} knows no depth"

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[NoiseRenderer]:
        self.opened.append(scene.max_depth)
        yield NoiseRenderer(self.mean, 0.01, (12, 16))


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    reference = Estimate.exact(np.full((12, 16, 3), 0.4))
    with Session(SCENE, [Noise(), Noise("other", 0.25)], folder=tmp_path,
                 find_reference=lambda scene: reference if scene.max_depth is None else None) as made:
        yield made


def test_it_grows_by_batches_that_grow(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("harness.view.session.BATCH_SECONDS", 1e9)
    for samples in (1, 3, 7, 15, 31, 63, 127, 191):
        session.advance()
        assert session.samples == samples
    monkeypatch.setattr("harness.view.session.BATCH_SECONDS", 0.0)
    session.press("r")
    assert session.samples == 0 and (session.image == 0).all()
    for samples in (1, 2, 3):  # none is longer than the first while each takes too long
        session.advance()
        assert session.samples == samples


def test_samples_of_a_replica_end(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """The next one goes on: a stranger's shader has so many frames and no more."""
    monkeypatch.setattr("harness.view.session.REPLICA", 4)
    monkeypatch.setattr("harness.view.session.BATCH_SECONDS", 1e9)
    for _ in range(4):
        session.advance()
    assert session._renderer().calls == [(0, 0, 1), (0, 1, 2), (0, 3, 1), (1, 0, 4)]  # type: ignore[attr-defined]


def test_left_and_right_choose_the_estimator(session: Session) -> None:
    session.advance()
    session.press("right")
    assert (session.estimator.name, session.samples) == ("other", 0)
    session.advance()
    assert session.image.mean() == pytest.approx(0.25, abs=0.01)
    session.press("right")
    assert session.estimator.name == "noise"
    session.press("left")
    assert session.estimator.name == "other"


def test_exposure_changes_what_is_shown_and_nothing_else(session: Session) -> None:
    session.advance()
    before = session.image
    for key in ("up", "up", "up", "down"):
        session.press(key)
    assert session.chosen.exposure == 1.0 and session.samples == 1
    np.testing.assert_array_equal(session.image, before)
    assert "+1 stops" in session.title


def test_depth_is_counted_from_the_scenes_own(session: Session) -> None:
    """And an estimator that has none says so."""
    session.press("page down")
    session.advance()
    assert session.chosen.depth == 7 and session.estimator.opened == [7]  # type: ignore[attr-defined]
    for _ in range(9):
        session.press("page down")
    assert session.chosen.depth == 1 and "depth 1" in session.title
    session.press("right")
    session.press("page up")
    assert session.message == "other knows no depth" and session.chosen.depth == 1


def test_space_pauses(session: Session) -> None:
    session.press("space")
    session.advance()
    assert session.samples == 0 and session.title.endswith("paused")
    session.press("space")
    session.advance()
    assert session.samples == 1


def test_the_title_tells_samples_and_error(session: Session) -> None:
    session.advance()
    assert session.title.startswith("furnace_cube | noise | 1 spp | mean +25.0")
    assert session.errors["rmse"] == pytest.approx(0.1, abs=0.005)
    session.press("page down")
    session.advance()
    assert session.title.endswith("depth 7 | 1 spp | no reference")


def test_s_saves_what_is_shown(session: Session, tmp_path: Path) -> None:
    session.press("s")
    assert session.message == "nothing to save yet" and not session.saved
    for _ in range(3):
        session.advance()
    session.press("up")
    session.press("s")
    exr, png = session.saved
    estimate, facts = read_estimate(exr)
    assert exr.parent == tmp_path and exr.name == f"furnace_cube-noise-{session.samples}spp.exr"
    np.testing.assert_array_equal(estimate.mean, session.image.astype(np.float32))
    assert (facts["strategy"], facts["spp"], facts["exposure"]) == ("noise", session.samples, 0.5)
    with Image.open(png) as picture:
        shown = np.asarray(picture)
    assert abs(int(shown.mean()) - int(display(session.image, 0.5).mean())) <= 1
    assert f"saved {exr.name}" in session.title


@dataclass
class Scripted:
    """A screen on which somebody presses keys, one list of them a picture."""

    script: list[list[str]]
    shown: list[tuple[float, float]] = field(default_factory=list)
    names: list[str] = field(default_factory=list)

    @property
    def closed(self) -> bool:
        return not self.script

    def name(self, title: str) -> None:
        self.names.append(title)

    def keys(self) -> list[str]:
        return self.script.pop(0)

    def show(self, image: np.ndarray, exposure: float = 0.0) -> None:
        self.shown.append((float(image.mean()), exposure))


def test_the_loop_answers_keys_between_pictures(session: Session) -> None:
    """Until Q, or until the window is closed."""
    screen = Scripted([[], ["up"], ["right"], ["q"], ["up"]])
    watch(session, screen)
    means, exposures = zip(*screen.shown, strict=True)
    assert means == pytest.approx((0.5, 0.5, 0.25), abs=0.01) and exposures == (0.0, 0.5, 0.5)
    assert screen.script == [["up"]] and session.done
    session.done = False
    session.press("escape")
    assert session.done
    closing = Scripted([[]])
    session.done = False
    watch(session, closing)
    assert len(closing.shown) == 1


def test_the_picture_is_the_tracers() -> None:
    """Batch by batch: the same samples, summed in float64."""
    scene = SceneFile.bundled("spheres", (16, 12))
    with Session(scene, [Tracer("uniform"), Tracer("mixture")], Watched(1)) as session:
        counts = []
        for _ in range(3):
            before = session.samples
            session.advance()
            counts.append((before, session.samples - before))
        found = session.image
    total = np.zeros((12, 16, 3))
    with Tracer("mixture").open(scene) as renderer:
        for start, count in counts:
            total += renderer.render_batch(0, start, count).mean.astype(np.float64) * count
    np.testing.assert_allclose(found, total / session.samples, rtol=1e-12)
