"""`harness study`: verdicts and statuses, references given, what is kept, and a cache that spares the work."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from harness.samples.estimate import Estimate
from harness.samples.exr import write_estimate
from harness.scene import load_scene
from harness.studies.storage import load_study
from tests.cli.conftest import SKY, Harness, refusal
from tests.support.metrics import register

BRIEF = ("--spp", 8, "--replicas", 2)
FULL = np.broadcast_to([0.5, 0.25, 1.0], (12, 16, 3))  # what the sky's scene shows


def reference(scene: Path, name: str = "truth.exr", scale: float = 1.0) -> str:
    facts = {"harness.scene": load_scene(scene).content_hash}
    write_estimate(name, Estimate.exact(FULL * scale), facts)
    return name


class TestStatus:
    """0 when every strategy that suits the scene passes, 1 otherwise."""

    def test_is_0_where_every_verdict_is_pass(self, harness: Harness, sky: Path) -> None:
        done = harness("study", sky, *BRIEF)
        assert done.status == 0
        assert done.err == ""
        told = [line.split(":")[0] for line in done.out.splitlines() if ": pass: " in line]
        assert told[::3] == ["uniform", "cosine", "phong", "lobes", "mixture"]
        assert told[1::3] == ["  tiles of 4 px"] * 5 and told[2::3] == ["  tiles of 1 px"] * 5

    @pytest.mark.parametrize("scale", [1.02, 0.98])
    def test_is_1_where_the_reference_says_otherwise(self, harness: Harness, sky: Path, scale: float) -> None:
        done = harness("study", sky, *BRIEF, "--reference", reference(sky, scale=scale), "--json")
        assert done.status == 1
        assert {item["verdict"]["outcome"] for item in done.json["strategies"]} == {"fail"}

    def test_is_1_where_a_tile_fails_although_the_mean_is_right(self, harness: Harness, sky: Path) -> None:
        patched = FULL.copy()
        patched[4:8, 4:8] *= 1.1
        patched[0:4, 8:12] *= 0.9
        write_estimate("patched.exr", Estimate.exact(patched), {"harness.scene": load_scene(sky).content_hash})
        done = harness("study", sky, *BRIEF, "-s", "mixture", "--reference", "patched.exr", "--json")
        item, = done.json["strategies"]
        assert done.status == 1
        assert (item["outcome"], item["verdict"]["outcome"]) == ("fail", "pass")
        assert item["tiles"]["coarse"]["outcome"] == item["tiles"]["fine"]["outcome"] == "fail"
        assert "the tile at x=8, y=0" in item["tiles"]["coarse"]["reason"]

    def test_does_not_depend_on_strategies_that_do_not_suit(self, harness: Harness, sky: Path) -> None:
        """Lobe-only sampling of a diffuse term is biased, and said to be; nobody's render is wrong for it."""
        sky.write_text(SKY.replace("</scene>", """<shape type="rectangle">
            <transform name="to_world"><scale value="9"/><rotate y="1" angle="180"/><translate z="3"/></transform>
            <bsdf type="phong"><float name="kd" value="0.5"/><float name="ks" value="0"/></bsdf></shape></scene>"""))
        done = harness("study", sky, *BRIEF, "--strategies", "phong", "--json")
        assert done.status == 0
        assert done.json["strategies"][0]["suits"] is False
        assert done.json["strategies"][0]["verdict"]["outcome"] != "pass"
        assert "warning: strategy 'phong': " in done.err


class TestJson:
    """One object with the curves of every strategy."""

    def test_holds_curves_verdicts_and_costs(self, harness: Harness, sky: Path) -> None:
        answer = harness("study", sky, *BRIEF, "--strategies", "mixture,uniform", "--json").json
        assert answer["scene"] == "sky"
        assert answer["scene_hash"] == load_scene(sky).content_hash
        assert [item["strategy"] for item in answer["strategies"]] == ["mixture", "uniform"]
        for item in answer["strategies"]:
            assert item["spp"] == [1, 2, 4, 8]
            assert np.shape(item["rmse"]) == np.shape(item["ssim"]) == np.shape(item["mean_error"]) == (2, 4)
            assert item["outcome"] == item["verdict"]["outcome"] == "pass"
            assert [np.shape(item["tiles"][size]["z"]) for size in ("coarse", "fine")] == [(3, 4), (12, 16)]
            assert item["seconds_per_spp"] > 0

    def test_names_a_strategy_once_however_often_it_was_asked_for(self, harness: Harness, sky: Path) -> None:
        answer = harness("study", sky, *BRIEF, "--strategies", " mixture , mixture,mixture", "--json").json
        assert [item["strategy"] for item in answer["strategies"]] == ["mixture"]


def test_values_of_the_scenes_parameters_stand_in_every_row(harness: Harness, sky: Path) -> None:
    """`--set` reaches tracer, reference, JSON and table; the scene's name there is without them."""
    sky.write_text(SKY.replace("0.5, 0.25, 1", "$blue").replace("<emitter", '<default name="blue" value="1"/><emitter'))
    done = harness("study", sky, *BRIEF, "-s", "mixture", "--set", "blue=0.5", "-o", "kept", "--json")
    assert (done.status, done.json["parameters"]) == (0, {"blue": "0.5"})
    with Path("kept/table.csv").open(encoding="utf-8") as file:
        assert {(row["scene"], row["parameters"]) for row in csv.DictReader(file)} == {("sky", "blue=0.5")}
    np.testing.assert_allclose(load_study("kept").strategies[0].estimate.mean, 0.5)


def test_a_metric_that_is_new_in_the_registry_is_shown(harness: Harness, sky: Path,
                                                       monkeypatch: pytest.MonkeyPatch) -> None:
    register(monkeypatch)
    given = (*BRIEF, "-s", "mixture", "--reference", reference(sky, scale=1.1))
    item, = harness("study", sky, *given, "--json").json["strategies"]
    assert item["largest_error"] == [[pytest.approx(0.1, abs=1e-4)] * 4] * 2 and item["share_off"] == 1.0
    heading, first, *_ = harness("study", sky, *given).out.splitlines()
    assert re.split(r"  +", heading)[4:] == ["RMSE", "SSIM", "largest error", "share off", "slope", "interval",
                                             "s/spp", "device"]
    assert re.split(r"  +", first)[6:8] == ["0.1", "1.00"]


class TestReference:
    """A ready image instead of Mitsuba's."""

    @pytest.fixture(autouse=True)
    def no_mitsuba(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def refuse(*arguments: object) -> None:
            raise AssertionError("Mitsuba was asked")

        monkeypatch.setattr("harness.estimators.mitsuba.ReferenceRenderer", refuse)

    def test_is_taken_as_it_is(self, harness: Harness, sky: Path) -> None:
        done = harness("study", sky, *BRIEF, "-s", "mixture", "--reference", reference(sky), "--json")
        assert done.status == 0
        assert done.json["reference"] == "given"
        assert done.err == ""

    def test_of_unknown_variance_gives_curves_but_no_pass(self, harness: Harness, sky: Path) -> None:
        """As of any other renderer: its noise can neither be taken off nor be part of a verdict."""
        estimate = Estimate.exact(FULL)
        unknown = Estimate(estimate.mean, np.full_like(estimate.mean, np.nan), np.full((12, 16), np.nan),
                           estimate.image_mean, np.full(4, np.nan), samples=64, batches=1)
        write_estimate("theirs.exr", unknown)
        done = harness("study", sky, *BRIEF, "-s", "mixture", "--reference", "theirs.exr", "--json")
        assert done.status == 1
        assert done.json["strategies"][0]["rmse"] == [[0.0] * 4] * 2
        assert done.json["strategies"][0]["verdict"]["outcome"] == "inconclusive"
        assert "variance of the reference is unknown" in done.json["strategies"][0]["verdict"]["reason"]

    def test_of_another_scene_is_warned_of(self, harness: Harness, sky: Path) -> None:
        ready = reference(sky)
        sky.write_text(SKY.replace("0.25", "0.26"))
        done = harness("study", sky, *BRIEF, "-s", "mixture", "--reference", ready)
        assert done.err.startswith("warning: truth.exr: rendered from another scene, or another size or version of it")

    def test_that_is_not_finite_is_refused(self, harness: Harness, sky: Path) -> None:
        broken = FULL.copy()
        broken[0, 0] = np.nan
        write_estimate("broken.exr", Estimate.exact(broken))
        assert refusal(harness("study", sky, "--reference", "broken.exr")) == (
            "the reference holds pixels that are not finite; render it again")

    def test_of_another_size_is_refused(self, harness: Harness, sky: Path) -> None:
        assert refusal(harness("study", sky, "--size", "20x20", "--reference", reference(sky))) == (
            "the reference is 16 x 12 pixels, the scene 20 x 20; render both at the same size")

    def test_that_is_missing_is_refused(self, harness: Harness, sky: Path) -> None:
        assert refusal(harness("study", sky, "--reference", "typo.exr")).startswith("typo.exr: no such file")

    def test_excludes_the_samples_of_one_yet_to_be_rendered(self, harness: Harness, sky: Path) -> None:
        assert refusal(harness("study", sky, "--reference", reference(sky), "--reference-spp", 64)).startswith(
            "--reference-spp is for an image yet to be rendered")


def test_the_result_is_kept_where_asked(harness: Harness, sky: Path) -> None:
    """As a study that can be loaded, and as a table."""
    answer = harness("study", sky, *BRIEF, "-o", "kept/here", "--json").json
    with Path("kept/here/table.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["estimator"] for row in rows} == {item["strategy"] for item in answer["strategies"]}
    assert [float(row["value"]) for row in rows if (row["estimator"], row["quantity"], row["replica"])
            == ("uniform", "rmse", "1")] == answer["strategies"][0]["rmse"][1]
    assert all(row["device"] for row in rows)
    kept = load_study("kept/here")
    assert kept.scene_hash == answer["scene_hash"]
    assert [item.strategy for item in kept.strategies] == [item["strategy"] for item in answer["strategies"]]
    np.testing.assert_array_equal(kept.strategies[0].curves["rmse"], answer["strategies"][0]["rmse"])


def test_a_second_study_renders_nothing(harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = harness("study", sky, *BRIEF, "--json").json

    def refuse(*arguments: object) -> None:
        raise AssertionError("rendered again")

    for name in ("gpu.renderer.TracerRenderer", "reference.renderer.ReferenceRenderer"):
        monkeypatch.setattr(f"harness.{name}.render_batch", refuse)
    assert harness("study", sky, *BRIEF, "--json").json == first
