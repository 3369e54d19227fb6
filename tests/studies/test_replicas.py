"""Replicas of whatever is studied: streams, whole runs with a seed each, images that are there, and Mitsuba itself."""

from __future__ import annotations

import shlex
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.estimators.base import no_depth
from harness.estimators.by_scene import ByScene, Named, named
from harness.estimators.command import Command
from harness.estimators.mitsuba import Mitsuba
from harness.reference import ReferenceRenderer
from harness.results import StrategyResult
from harness.samples.estimate import Batch, Estimate
from harness.samples.exr import write_estimate
from harness.scene import SceneFile
from harness.studies.study import study
from tests.support.gates import SKY

SIZE = (12, 16)
EXACT = Estimate.exact(np.full((*SIZE, 3), 0.5))
# A program that draws normal noise about 0.5, and writes what it was asked for beside its image.
PROGRAM = """import array, random, sys
out, seed, spp, sigma, log = sys.argv[1], *map(float, sys.argv[2:5]), sys.argv[5]
drawn = random.Random(int(seed))
image = array.array("f", (drawn.gauss(0.5, sigma / spp**0.5) for _ in range(16 * 12 * 3)))
with open(out, "wb") as file:
    file.write(b"PF\\n16 12\\n-1.0\\n" + image.tobytes())
with open(log, "a") as file:
    file.write(f"{int(seed)} {int(spp)}\\n")
"""


@pytest.fixture
def scene(tmp_path: Path) -> SceneFile:
    path = tmp_path / "sky.xml"
    path.write_text(SKY.replace("<integrator", '<default name="sigma" value="1"/><integrator').replace(
        "<film", '<string name="note" value="$sigma"/><film'), encoding="utf-8")
    return SceneFile(path, (("sigma", "0.2"),), (SIZE[1], SIZE[0]))


def only(scene: SceneFile, estimator: object, **options: object) -> StrategyResult:
    given: dict[str, object] = {"spp": 8, "replicas": 3, "max_replicas": 3, "reference": EXACT, "tolerance": 0.2}
    found, = study(scene, [estimator], **{**given, **options}).strategies  # type: ignore[arg-type,list-item]
    return found


class TestCommands:
    """Each point of each curve is a run of its own."""

    @pytest.fixture
    def program(self, tmp_path: Path) -> Command:
        (tmp_path / "noise.py").write_text(PROGRAM, encoding="utf-8")
        words = [sys.executable, tmp_path / "noise.py", "{out}", "{seed}", "{spp}", "{sigma}", tmp_path / "log.txt"]
        return Command(shlex.join(map(str, words)), suffix=".pfm")

    def test_have_curves_of_runs_with_seeds_of_their_own(self, scene: SceneFile, program: Command,
                                                         tmp_path: Path) -> None:
        found = only(scene, program, spp=4)
        runs = [tuple(map(int, text.split())) for text in (tmp_path / "log.txt").read_text().splitlines()]
        assert [spp for _, spp in runs] == [1, 2, 4] * 3
        assert len({seed for seed, _ in runs}) == 9
        assert found.curves["rmse"].shape == (3, 3) and found.spp.tolist() == [1, 2, 4]
        np.testing.assert_allclose(found.curves["rmse"].mean(axis=0), 0.2 / np.sqrt([1, 2, 4]), rtol=0.1)
        assert found.estimate.samples == 12  # the longest of each replica
        assert found.slope is not None and found.slope.low < -0.5 < found.slope.high
        assert found.seconds_per_spp > 0 and (found.replica_seconds > 0).all()

    def test_are_asked_for_the_scenes_parameters(self, scene: SceneFile) -> None:
        with pytest.raises(HarnessError, match="the scene's parameter 'sigma' does not reach it"):
            only(scene, Command("myrt {seed} {out}"))

    def test_may_have_parameters_of_their_own(self, scene: SceneFile) -> None:
        command = Command("myrt {seed} {out} {sigma} {gamma}")
        assert command.takes(scene) == ("gamma", "sigma")
        assert command.check(replace(scene, besides=(("gamma", "2"), ("other's", "3")))) == ""
        with pytest.raises(HarnessError, match=r"unknown '\{gamma\}'; allowed: .*, \{sigma\}$"):
            command.check(scene)


class TestImages:
    """One point, as many replicas as there are files."""

    @pytest.fixture(autouse=True)
    def files(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.chdir(tmp_path)
        for sigma in ("0.2", "0.4"):
            for seed in range(4):
                noise = np.random.default_rng([seed, int(10 * float(sigma))]).standard_normal((*SIZE, 3))
                estimate = Estimate.exact(0.5 + float(sigma) * noise)
                write_estimate(f"sky_{sigma}_{seed}.exr", Estimate(
                    estimate.mean, np.full_like(noise, np.nan), np.full(SIZE, np.nan), estimate.image_mean,
                    np.full(4, np.nan), 16, 1))

    def test_are_found_by_the_scene_and_its_parameters(self, scene: SceneFile) -> None:
        estimator = ByScene("images", "{scene}_{sigma}_*.exr")
        assert estimator.name == "{scene}_{sigma}_*.exr" and not estimator.check(scene)
        found = only(scene, estimator, replicas=8)
        assert found.curves["rmse"].shape == (4, 1) and found.spp.tolist() == [16]
        np.testing.assert_allclose(found.curves["rmse"], 0.2, rtol=0.1)
        assert found.slope is None and np.isnan(found.seconds_per_spp)
        assert found.verdict.outcome == "pass"

    def test_are_called_what_one_likes(self) -> None:
        found = named("kept=sky_0.2_*.exr", lambda word: ByScene("images", word))
        assert isinstance(found, Named) and found.name == "kept"
        assert ByScene("images", "sky_0.2_*.exr").name == "sky_0.2_0.exr and 3 more"
        assert ByScene("images", "sky_0.2_{x}.exr").depends == ("x",)

    @pytest.mark.parametrize(("word", "message"), [
        ("{scene}_{alpha}.exr", r"unknown '\{alpha\}'; allowed: \{scene\}, \{sigma\}"),
        ("sky_{sigma.exr", "expected '}' before end of string; write braces of its own twice"),
        ("gone_*.exr", "no file matches this pattern"),
        ("sky_0.2_0.exr", "one render without variance"),
    ])
    def test_that_cannot_be_studied_are_refused(self, scene: SceneFile, word: str, message: str) -> None:
        with pytest.raises(HarnessError, match=message):
            ByScene("images", word).check(scene)

    def test_have_no_depth_to_set(self, scene: SceneFile) -> None:
        with pytest.raises(HarnessError, match="is what it is at every max_depth; leave out --max-depth"):
            ByScene("images", "sky_0.2_*.exr").check(scene.at_depth(1))


def test_mitsuba_is_never_its_own_reference(scene: SceneFile, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its replicas count from the last one down: with the same seeds its noise would be the reference's."""
    drawn: list[tuple[str, int]] = []

    def render(self: ReferenceRenderer, replica: int, start: int, count: int, advance: object = None) -> Batch:
        drawn.append((self.integrator, replica))
        noise = np.random.default_rng([replica, start]).standard_normal((*SIZE, 3))
        return Batch((0.5 + 0.01 * noise).astype(np.float32), count)

    monkeypatch.setattr(ReferenceRenderer, "render_batch", render)
    study(scene, [Mitsuba("path")], spp=8, replicas=2, max_replicas=2, tolerance=0.1)
    reference, own = ({replica for _, replica in drawn[:32]}, {replica for _, replica in drawn[32:]})
    assert reference == set(range(32)) and own == {1023, 1022}


def test_a_stranger_under_another_name_is_the_same(scene: SceneFile) -> None:
    found = named("mine=path", Mitsuba)
    assert (found.name, found.check(scene), no_depth(found, scene)) == ("mine", "", "")
    assert named("myrt --spp={spp}", lambda word: Command(f"{word} {{seed}} {{out}}")).name == "myrt"
