"""Estimators: values that open renderers, and let go of what these hold."""

from __future__ import annotations

import dataclasses
import pickle
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.estimators.base import Estimator
from harness.estimators.constant import Constant
from harness.estimators.coupled import Coupled
from harness.estimators.held import OneAtATime
from harness.estimators.images import Images
from harness.estimators.mitsuba import Mitsuba
from harness.estimators.tracer import Tracer
from harness.gpu.renderer import TracerRenderer
from harness.reference.coupled import CoupledRenderer
from harness.reference.renderer import ReferenceRenderer
from harness.samples.estimate import Estimate
from harness.samples.exr import write_estimate
from harness.scene import SceneFile
from harness.shader.library import OURS
from tests.support.fakes import NoiseRenderer

SCENE = SceneFile.bundled("furnace_convex", (8, 6))
LINE = ("lib/phong.glsl", "return m.kd;", "return m.ks;")
ESTIMATORS = [Tracer(), Tracer("cosine", OURS.with_line(*LINE)), Tracer(without=("lens",)),
              Tracer(shader=Path("own.frag"), folder=Path("own")), Mitsuba(), Mitsuba("path", 3, "llvm_ad_spectral"),
              Coupled(), Coupled("cosine"),
              Constant((0.5, 0.25, 1.0)), Images((Path("truth.exr"),))]


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=repr)
def test_are_values(estimator: Estimator) -> None:
    """They travel to other processes, and are keys of what is shared."""
    copy = pickle.loads(pickle.dumps(estimator))
    assert copy == estimator and hash(copy) == hash(estimator)
    assert [other for other in ESTIMATORS if other == copy] == [estimator]
    with pytest.raises(dataclasses.FrozenInstanceError):
        estimator.name = "another"  # type: ignore[misc]


@pytest.mark.parametrize(("estimator", "renderer"), [
    (Tracer("cosine"), TracerRenderer), (Mitsuba(), ReferenceRenderer), (Coupled("cosine"), CoupledRenderer)])
def test_let_go_of_what_they_hold_whatever_happens(
    estimator: Estimator, renderer: type, monkeypatch: pytest.MonkeyPatch,
) -> None:
    released: list[object] = []
    honest = renderer.release

    def release(self: object) -> None:
        released.append(self)
        honest(self)

    monkeypatch.setattr(renderer, "release", release)
    with estimator.open(SCENE) as opened:
        assert opened.render_batch(0, 0, 2).mean.shape == (6, 8, 3)
        assert released == []
    assert released == [opened]
    with pytest.raises(KeyboardInterrupt), estimator.open(SCENE) as interrupted:
        raise KeyboardInterrupt
    assert released == [opened, interrupted]


def test_a_constant_is_one_colour_of_the_films_size() -> None:
    with Constant((0.5, 0.25, 1.0)).open(SCENE) as renderer:
        found = renderer.render_batch(0, 0, 4).mean
        fixed = renderer.traits.fixed
    np.testing.assert_array_equal(found, np.broadcast_to(np.float32([0.5, 0.25, 1.0]), (6, 8, 3)))
    assert fixed is not None and fixed.batches == 0


def test_a_stored_image_is_what_is_in_the_file_and_of_the_scenes_size(tmp_path: Path) -> None:
    image = np.linspace(0, 1, 6 * 8 * 3).reshape(6, 8, 3).astype(np.float32)
    write_estimate(tmp_path / "truth.exr", Estimate.exact(image))
    with Images((tmp_path / "truth.exr",)).open(SCENE) as renderer:
        np.testing.assert_array_equal(renderer.render_batch(0, 0, 1).mean, image)
    with pytest.raises(HarnessError, match="is 8 x 6, expected 9 x 6"), Images((tmp_path / "truth.exr",)).open(
            SCENE.sized(9, 6)):
        pass


def test_a_tracer_says_what_its_strategy_misses_and_refuses_one_that_is_none() -> None:
    assert Tracer("mixture").check(SceneFile.bundled("spheres")) == ""
    assert "biased" in Tracer("phong").check(SceneFile.bundled("spheres"))
    with pytest.raises(HarnessError, match="unknown strategy 'metropolis'"):
        Tracer("metropolis").check(SCENE)


@dataclass(frozen=True)
class Counted:
    """An estimator that tells when it opens and closes."""

    name: str
    told: list[str] = field(compare=False)

    def check(self, scene: SceneFile) -> str:
        return ""

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[NoiseRenderer]:
        self.told.append(f"open {self.name}")
        try:
            yield NoiseRenderer(size=(4, 4))
        finally:
            self.told.append(f"close {self.name}")


class TestOneAtATime:
    """Living scenes slow each other down."""

    def test_opens_one_and_opens_it_again_when_it_is_needed(self) -> None:
        told: list[str] = []
        with OneAtATime() as held:
            first, second = (held.of(Counted(name, told), SCENE) for name in "ab")
            assert told == ["open a", "close a", "open b"]
            second.render_batch(0, 0, 1)
            assert len(told) == 3, "the one that is open stays open"
            before = first.render_batch(0, 0, 1)
            assert told[3:] == ["close b", "open a"]
            np.testing.assert_array_equal(first.render_batch(0, 0, 1).mean, before.mean)
            assert first.identity == NoiseRenderer(size=(4, 4)).identity
        assert told[5:] == ["close a"]
        held.close()
        assert told[5:] == ["close a"], "closed once"

    def test_of_another_size_is_another(self) -> None:
        told: list[str] = []
        with OneAtATime() as held:
            one = Counted("a", told)
            held.of(one, SCENE)
            held.of(one, SCENE)
            assert told == ["open a"]
            held.of(one, SCENE.sized(3, 3))
            assert told == ["open a", "close a", "open a"]

    def test_holds_nothing_of_what_cannot_be_opened(self) -> None:
        told: list[str] = []
        with OneAtATime() as held:
            held.of(Counted("a", told), SCENE)
            with pytest.raises(HarnessError, match="unknown strategy"):
                held.of(Tracer("metropolis"), SCENE)
            assert told == ["open a", "close a"]
            held.of(Counted("a", told), SCENE)
        assert told == ["open a", "close a"] * 2
