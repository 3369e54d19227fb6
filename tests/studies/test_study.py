"""Studies on real scenes, small: curves, verdicts, added replicas, continuation."""

from __future__ import annotations

import dataclasses
import weakref
from pathlib import Path

import numpy as np
import pytest

from harness import load_scene, study
from harness.errors import HarnessError
from harness.files import data_dir
from harness.policy import fail_level, judge, tolerance_for
from harness.reference import ReferenceRenderer
from harness.report.tables import slope_mark
from harness.results import StrategyResult
from harness.samples.estimate import Batch, Estimate
from harness.samples.store import Store, schedule
from harness.scene import Film, Scene
from harness.scene.model import Displacement, Procedural
from harness.scene.strategies import Suited
from harness.stats.deviates import staged
from harness.stats.verdicts import Tolerance
from harness.studies.plan import PROFILES, exhibited_strategies, judged, prefix_sizes, replicas_needed
from harness.studies.replicas import Reference, Replicas
from harness.work.batches import render_estimate
from harness.work.run import tiles_of
from tests.support.fakes import NoiseRenderer
from tests.support.gates import Opens

SPHERES = data_dir("mitsuba_scenes") / "spheres.xml"


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(SPHERES, width=48, height=36)


def test_every_suiting_strategy_agrees_with_mitsuba_and_converges_as_it_should(scene: Scene, tmp_path: Path) -> None:
    """The whole chain on the course's scene: uniform and importance sampling reach Mitsuba's mean within 1 %."""
    result = study(scene, spp=256, replicas=4, reference_spp=2048, tolerance=0.01, store=Store(tmp_path))
    assert [item.strategy for item in result.strategies] == ["uniform", "cosine", "lobes", "mixture"]
    for item in result.strategies:
        assert item.verdict.outcome == "pass", f"{item.strategy}: {item.verdict.reason}"
        assert item.slope is not None
        assert item.slope.low - 0.05 < -0.5 < item.slope.high + 0.05
        assert item.estimate.rejected == 0
        assert item.curves.keys() == {"rmse", "mean_error", "ssim"}
        assert {curve.shape for curve in item.curves.values()} == {(len(item.curves["rmse"]), 9)}
    error = {item.strategy: item.score("rmse") for item in result.strategies}
    assert error["mixture"] < 0.5 * error["uniform"]
    similarity = {item.strategy: item.score("ssim") for item in result.strategies}
    assert similarity["mixture"] > similarity["uniform"]


def test_samplers_are_an_axis_and_only_replicas_tell_the_noise_of_the_one_that_spreads(tmp_path: Path) -> None:
    """A smooth scene: both right; Sobol's samples fall faster than 1/√N, are judged by their replicas alone, and by
    slopes of their own."""
    scene = load_scene(data_dir("mitsuba_scenes") / "furnace_convex.xml", width=32, height=24)
    result = study(scene, ["uniform"], samplers=("independent", "sobol"), spp=64, replicas=6, reference_spp=2048,
                   tolerance=0.01, store=Store(tmp_path))
    usual, spread = result.strategies
    assert (usual.strategy, spread.strategy) == ("uniform", "uniform sobol")
    assert [item.verdict.outcome for item in result.strategies] == ["pass", "pass"]
    assert spread.estimate.batches == len(spread.curves["rmse"]) == 6
    assert usual.estimate.batches > len(usual.curves["rmse"])
    assert (usual.expected, spread.expected) == ((-0.5,), (-1.0, -0.75, -0.5))
    assert usual.slope is not None and spread.slope is not None
    assert spread.slope.high < -0.6 < usual.slope.low
    assert (slope_mark(usual), slope_mark(spread)) == ("pass", "pass")
    assert spread.score("rmse") < usual.score("rmse") / 3
    with pytest.raises(HarnessError, match="unknown sampler 'halton'"):
        study(scene, ["uniform"], samplers=("halton",), spp=4)


def test_a_strategy_that_misses_light_is_warned_of_and_judged_biased(scene: Scene) -> None:
    result = study(scene, ["phong"], spp=64, replicas=2, reference_spp=512)
    assert not result.strategies[0].suits
    assert "biased" in result.strategies[0].warning
    assert len(result.strategies[0].curves["rmse"]) == 2, "no replicas are added for a verdict that does not count"


def test_a_reference_brighter_by_two_percent_fails_the_tracer(scene: Scene, tmp_path: Path) -> None:
    honest = study(scene, ["mixture"], spp=256, replicas=4, reference_spp=2048, store=Store(tmp_path))
    brighter = honest.reference.mean * 1.02
    result = study(scene, ["mixture"], spp=256, replicas=4, reference=Estimate.exact(brighter), store=Store(tmp_path))
    assert result.strategies[0].verdict.outcome == "fail"


def test_a_study_read_back_from_its_batches_is_the_same(scene: Scene, tmp_path: Path) -> None:
    reference = Estimate.exact(np.full((36, 48, 3), 0.4))
    first, again = (study(scene, ["lobes"], spp=64, replicas=2, max_replicas=2, reference=reference,
                          store=Store(tmp_path)).strategies[0] for _ in range(2))
    np.testing.assert_array_equal(first.curves["rmse"], again.curves["rmse"])
    np.testing.assert_array_equal(first.estimate.mean, again.estimate.mean)
    assert first.seconds_per_spp == again.seconds_per_spp


def test_no_run_is_ever_held_whole() -> None:
    """A long run has thousands of batches, each as large as the image."""
    held: weakref.WeakSet[Batch] = weakref.WeakSet()
    most = 0

    class Watched(NoiseRenderer):
        def render_batch(self, *arguments: int, **options: object) -> Batch:  # type: ignore[override]
            nonlocal most
            batch = super().render_batch(*arguments, **options)  # type: ignore[arg-type]
            held.add(batch)
            most = max(most, len(held))
            return batch

    estimate = Estimate.exact(np.full((12, 16, 3), 0.5))
    run = Replicas(Suited("mixture", suits=True), Film(16, 12), Watched(size=(12, 16)),
                    Reference(estimate, tiles_of(estimate, 2)), 4096)
    run.add_replica(None, lambda n: None, curve=True)
    assert run.total.samples == 4096
    assert most <= 10, f"{most} of {len(schedule(4096))} batches at once"


def test_replicas_are_added_as_often_as_their_own_variance_asks_for_them_and_without_curves(
        scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """A pilot that saw too small a variance, then one that saw it right, then few that are missing."""
    asked: list[int] = []

    def needed(estimate: Estimate, reference: Estimate, replicas: int, tolerance: float) -> int:
        asked.append(replicas)
        return {4: 8, 8: 12, 12: 13}[replicas]

    monkeypatch.setattr("harness.studies.study.replicas_needed", needed)
    result, = study(scene, ["uniform"], spp=8, replicas=4,
                    reference=Estimate.exact(np.full((36, 48, 3), 0.5))).strategies
    assert asked == [4, 8, 12]
    assert result.estimate.samples == 12 * 8
    assert result.curves["rmse"].shape == (4, 4)
    assert result.estimate.image_third is not None and result.estimate.image_third.all()
    first, every = result.estimate.batches / 3, result.estimate.batches
    np.testing.assert_allclose(result.verdict.dof, staged(first - 1, every - 1))
    own = judge(result.estimate, Estimate.exact(np.full((36, 48, 3), 0.5)), looked=(round(first), None),
                tolerance=result.verdict.tolerance)
    np.testing.assert_array_equal(own.low, result.verdict.low)


@pytest.mark.parametrize(("options", "message"), [
    ({"spp": 0}, "at least 1"),
    ({"replicas": 1}, "at least 2 replicas"),
    ({"strategies": ["metropolis"]}, "unknown strategy 'metropolis'"),
    ({"reference": Estimate.exact(np.ones((4, 4, 3)))}, "4 x 4 pixels"),
    ({"reference": Estimate.exact(np.full((36, 48, 3), np.nan))}, "not finite"),
])
def test_what_cannot_be_studied_is_refused_in_one_line(scene: Scene, options: dict[str, object], message: str) -> None:
    with pytest.raises(HarnessError, match=message) as caught:
        study(scene, **options)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_prefixes_are_powers_of_two_and_the_whole() -> None:
    assert prefix_sizes(8) == [1, 2, 4, 8]
    assert prefix_sizes(12) == [1, 2, 4, 8, 12]
    assert prefix_sizes(1) == [1]


class TestReplicasNeeded:
    """Stein's two-stage sample size."""

    pilot = render_estimate(NoiseRenderer(sigma=0.5, size=(8, 8)), 1024)
    exact = Estimate.exact(np.full((8, 8, 3), 0.5))

    def test_grow_with_the_inverse_square_of_the_tolerance(self) -> None:
        loose, tight = (replicas_needed(self.pilot, self.exact, 8, tolerance) for tolerance in (0.002, 0.001))
        assert loose > 8
        assert tight == pytest.approx(4 * loose, rel=0.02)

    def test_are_never_fewer_than_the_pilot_had(self) -> None:
        assert replicas_needed(self.pilot, self.exact, 8, 0.5) == 8

    def test_do_not_depend_on_the_error(self) -> None:
        shifted = dataclasses.replace(self.pilot, image_mean=self.pilot.image_mean + 0.1)
        assert replicas_needed(shifted, self.exact, 8, 0.002) == replicas_needed(self.pilot, self.exact, 8, 0.002)

    def test_have_no_bound_when_the_reference_is_too_noisy(self) -> None:
        noisy = dataclasses.replace(self.exact, image_variance=np.full(4, 1.0))
        assert replicas_needed(self.pilot, noisy, 8, 0.002) > 10**6


@pytest.mark.parametrize(("tolerance", "samples"), [(0.5, 16), (0.002, 16 * 16)])
def test_a_reference_grows_until_its_noise_leaves_the_verdict_room(scene: Scene, tolerance: float, samples: int,
                                                                   tmp_path: Path) -> None:
    """By its own variance, and to sixteen times what was asked for at the most."""
    result = study(scene, ["mixture"], spp=4, replicas=2, max_replicas=2, reference_spp=16, tolerance=tolerance,
                   store=Store(tmp_path))
    assert result.reference.samples == samples


class TestWhatAReportShows:
    """Strategies and tolerance, from the scene."""

    def test_all_that_suit_and_the_lobe_as_a_warning(self, scene: Scene) -> None:
        assert exhibited_strategies(scene) == ("uniform", "cosine", "phong", "lobes", "mixture")

    def test_those_that_the_scene_file_names(self, tmp_path: Path) -> None:
        """A property of the integrator, which neither the image nor Mitsuba sees."""
        named = self.named(tmp_path, "mixture, cosine")
        assert exhibited_strategies(named) == ("mixture", "cosine")
        assert named.content_hash == load_scene(SPHERES, width=8, height=6).content_hash
        assert render_estimate(ReferenceRenderer(named.file), 2).mean.shape == (6, 8, 3)

    def test_an_unknown_one_is_refused(self, tmp_path: Path) -> None:
        with pytest.raises(HarnessError, match=r"named\.xml: integrator property 'strategies': unknown strategy"):
            exhibited_strategies(self.named(tmp_path, "mixture, mi"))

    @staticmethod
    def named(folder: Path, strategies: str) -> Scene:
        """A scene whose file names these strategies."""
        path, depth = folder / "named.xml", '<integer name="max_depth" value="6"/>'
        path.write_text(SPHERES.read_text(encoding="utf-8").replace(
            depth, f'{depth}<string name="strategies" value="{strategies}"/>'), encoding="utf-8")
        return load_scene(path, width=8, height=6)

    def test_a_mesh_in_the_reference_widens_the_tolerance_and_says_so(self, scene: Scene) -> None:
        fractal = Procedural("fractal", ((0.0,) * 3, (1.0,) * 3), 1, 2.0, 0.5, 1.0, 0.0, 0, scene.shapes[0].to_world)
        bumpy = dataclasses.replace(scene.shapes[1], displacement=Displacement(fractal, 0.1))
        assert tolerance_for(scene) == (Tolerance(), "")
        tolerance, reason = tolerance_for(dataclasses.replace(scene, shapes=(scene.shapes[0], bumpy)))
        assert tolerance == Tolerance(mean=0.005)
        assert "0.5% instead of 0.2%" in reason


class TestTiles:
    """Beside the mean, parts of the image are judged."""

    truth = np.full((36, 48, 3), 0.5)

    @pytest.fixture
    def noise(self) -> NoiseRenderer:
        """Normal noise in place of the tracer."""
        return NoiseRenderer(size=(36, 48))

    def study(self, scene: Scene, noise: NoiseRenderer, **options: object) -> StrategyResult:
        reference = Estimate.exact(self.truth)
        return study(scene, [Opens(noise)], spp=256, replicas=8, reference=reference, **options).strategies[0]  # type: ignore[arg-type]

    def test_a_defect_that_the_mean_does_not_know_of_fails(self, scene: Scene, noise: NoiseRenderer) -> None:
        noise.mean = self.truth.copy()
        noise.mean[8:16, 16:24] *= 1.1
        noise.mean[24:32, 16:24] *= 0.9
        found = self.study(scene, noise)
        assert (found.verdict.outcome, found.outcome) == ("pass", "fail")
        assert found.tiles.coarse.outcome == "fail"
        assert (found.tiles.coarse.x, found.tiles.coarse.y) in ((16, 8), (16, 24))

    def test_noise_in_tiles_leaves_the_outcome_to_the_mean(self, scene: Scene, noise: NoiseRenderer) -> None:
        noise.sigma = np.full((36, 48, 1), 0.1)
        noise.sigma[:2, :2] = 5.0
        found = self.study(scene, noise)
        assert (found.verdict.outcome, found.tiles.fine.outcome, found.outcome) == ("pass", "inconclusive", "pass")

    def test_a_larger_family_leaves_each_a_smaller_level(self, scene: Scene, noise: NoiseRenderer) -> None:
        alone, shared = self.study(scene, noise), self.study(scene, noise, family=100)
        assert alone.tiles.fine.fail_level == pytest.approx(0.01 / 3, rel=0.01)
        assert shared.tiles.fine.fail_level == pytest.approx(0.01 / 300, rel=0.01)
        assert (shared.verdict.smallest_detectable > 1.3 * alone.verdict.smallest_detectable).all()

    def test_a_family_is_every_strategy_that_suits(self, scene: Scene) -> None:
        """phong does not suit: of five shown, four are judged, and the best of them once more by even numbers."""
        assert judged([scene, scene], PROFILES["quick"]) == 10
        assert judged([scene, scene], PROFILES["full"]) == 16
        result = study(scene, ["cosine", "phong"], spp=4, replicas=2, max_replicas=2,
                       reference=Estimate.exact(self.truth))
        assert {item.tiles.fine.fail_level for item in result.strategies} == {fail_level(1)}

    def test_come_out_the_same_from_the_store(self, scene: Scene, tmp_path: Path) -> None:
        first, again = (study(scene, ["mixture"], spp=16, replicas=2, max_replicas=2, reference_spp=64, tolerance=0.05,
                              store=Store(tmp_path)) for _ in range(2))
        assert first.reference.batches == again.reference.batches >= 32
        for size in ("coarse", "fine"):
            one, other = (getattr(result.strategies[0].tiles, size) for result in (first, again))
            np.testing.assert_array_equal(one.z, other.z)
            assert one.reason == other.reason
