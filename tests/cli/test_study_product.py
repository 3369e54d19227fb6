"""`harness study` over parameters and of other renderers, and `harness compare-studies`: what is said and kept."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.cli.options import open_store
from harness.cli.studied import notes
from harness.estimators.by_scene import ByScene
from harness.estimators.shader import Shader, ShaderRenderer
from harness.notebook import parameter_study
from harness.samples.estimate import Batch, Estimate
from harness.samples.exr import write_estimate
from harness.scene import SceneFile
from harness.studies.kept import Kept, load_studies
from harness.studies.parameters import parse_axes
from harness.studies.product import StudyProduct
from tests.cli.conftest import SKY, Harness, refusal
from tests.support.ball import SCENE, body
from tests.support.studies import line, study

BRIEF = ("--spp", 4, "--replicas", 2)


@pytest.fixture
def tinted(tmp_path: Path) -> Path:
    """A sky whose blue and red are parameters."""
    path = tmp_path / "tinted.xml"
    path.write_text(SKY.replace("0.5, 0.25, 1", "$red, 0.25, $blue").replace(
        "<emitter", '<default name="blue" value="1"/><default name="red" value="1"/><emitter'), encoding="utf-8")
    return path


def test_every_combination_makes_one_table_and_figures(harness: Harness, tinted: Path, sky: Path) -> None:
    sky.write_text(tinted.read_text(encoding="utf-8"), encoding="utf-8")
    done = harness("study", tinted, sky, *BRIEF, "-s", "mixture,uniform", "--set", "blue=0.5,1", "--set", "red=0.25",
                   "-o", "kept")
    assert (done.status, done.err) == (0, "")
    assert done.out.splitlines()[-1] == "8 of 8 lines pass, in 4 studies"
    assert done.out.splitlines()[0].split()[:4] == ["scene", "blue", "red", "strategy"]
    with Path("kept/table.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {(row["scene"], row["blue"], row["red"], row["estimator"]) for row in rows} == {
        (scene, blue, "0.25", name) for scene in ("tinted", "sky") for blue in ("0.5", "1")
        for name in ("mixture", "uniform")}
    kept = {path.name for path in Path("kept").iterdir()}
    assert {"table.parquet", "product.json", "error-by-samples.svg", "error-by-time.svg", "error-by-blue.svg",
            "ssim.svg", "mean-error.svg", "efficiency.svg"} <= kept
    again = harness("compare-studies", "kept", "kept", "--json")
    assert (again.status, len(again.json["cells"])) == (0, 8)


def test_as_json_a_product_is_its_studies(harness: Harness, tinted: Path) -> None:
    answer = harness("study", tinted, *BRIEF, "-s", "mixture", "--set", "blue=0.5,1", "--json").json
    assert answer["parameters"] == {"blue": ["0.5", "1"]}
    assert [each["parameters"] for each in answer["studies"]] == [{"blue": "0.5"}, {"blue": "1"}]
    assert answer["studies"][0]["strategies"][0]["outcome"] == "pass"


def test_others_are_studied_beside_us(harness: Harness, tinted: Path) -> None:
    """Images that the parameter names, and Mitsuba; ours only where it is asked for."""
    for blue in ("0.5", "1"):
        for seed in range(3):
            noise = 0.001 * np.random.default_rng(seed).standard_normal((12, 16, 3))
            write_estimate(f"sky_{blue}_{seed}.exr", Estimate.exact(np.broadcast_to(
                [1.0, 0.25, float(blue)], (12, 16, 3)) + noise))
    done = harness("study", tinted, *BRIEF, "--set", "blue=0.5,1", "--images", "kept=sky_{blue}_*.exr",
                   "--integrators", "path", "--tolerance", 0.01, "--json")
    assert [[item["strategy"] for item in each["strategies"]] for each in done.json["studies"]] == [
        ["kept", "mitsuba path"]] * 2
    assert done.status == 0


@pytest.mark.parametrize(("words", "message"), [
    (("--set", "bleu=1,2"), "no parameter 'bleu'; it declares blue, red: write <default name=\"bleu\""),
    (("--set", "blue=1", "--set", "blue=2"), "--set: 'blue' is given twice"),
    (("--set", "blue=1,2", "--images", "a_*.exr"), "the same files for every blue; write {blue} into their name"),
    (("--images", "gone_*.exr"), "no file matches this pattern"),
    (("--command", "myrt {seed}"), "lacks {out}"),
    (("--integrators", "path,,"), "--integrators: expected names with commas between"),
    (("--set", "blue=1,2", "--reference", "truth.exr"), "--reference is one image, and 2 combinations are studied"),
    (("--shader", "gone.frag"), "gone.frag"),
])
def test_what_cannot_be_studied_is_refused_in_one_line(harness: Harness, tinted: Path, no_renderer: None,
                                                       words: tuple[str, ...], message: str) -> None:
    assert message in refusal(harness("study", tinted, *BRIEF, *words))


@pytest.fixture
def albedo(tmp_path: Path) -> Path:
    """A ball whose albedo is a parameter, and a shader of it in which it is a uniform."""
    path = tmp_path / "ball.xml"
    path.write_text(SCENE.replace("0.6, 0.5, 0.4", "$albedo").replace(
        "<integrator", '<default name="albedo" value="0.5"/><integrator', 1), encoding="utf-8")
    text = body("2.0 * rnd() * GAIN * vec3(albedo)")
    (tmp_path / "ball.frag").write_text(f"#define GAIN 1.0\nuniform float albedo;\n{text}", encoding="utf-8")
    return path


BALL = ("--spp", 32, "--replicas", 2, "--reference-spp", 32, "--tolerance", 0.05, "--json")


def test_a_parameter_reaches_a_strangers_shader_as_well_as_the_scene(harness: Harness, albedo: Path,
                                                                     monkeypatch: pytest.MonkeyPatch) -> None:
    """Two values are two pictures, each of which passes only where both sides have its value; and both are kept.
    A name of the shader alone, a macro, leaves the scene as it is, and the shader is drawn anew."""
    words = ("study", albedo, *BALL, "--shader", f"mine={albedo.with_suffix('.frag')}", "--set")
    done = harness(*words, "albedo=0.2,0.8", "-o", "kept")
    assert (done.status, done.err) == (0, "")
    assert [each["parameters"] for each in done.json["studies"]] == [{"albedo": "0.2"}, {"albedo": "0.8"}]
    dark, bright = (each.strategies[0] for each in load_studies("kept").studies)
    assert dark.estimate.image_mean[0] < bright.estimate.image_mean[0] - 0.1
    with Path("kept/table.csv").open(encoding="utf-8") as file:
        assert {row["albedo"] for row in csv.DictReader(file)} == {"0.2", "0.8"}

    drawn: list[int] = []
    render = ShaderRenderer.render_batch

    def watched(self: ShaderRenderer, replica: int, start: int, count: int, advance: object = None) -> Batch:
        drawn.append(replica)
        return render(self, replica, start, count)

    monkeypatch.setattr(ShaderRenderer, "render_batch", watched)
    assert harness(*words, "albedo=0.2,0.8").json == done.json and not drawn
    other, = parameter_study(albedo, [Shader((albedo.with_suffix(".frag"),))], spp=32, replicas=2, reference_spp=32,
                             tolerance=0.05, parameters={"albedo": 0.8, "GAIN": 0.5}, store=open_store(True))
    assert (other.cell[1], other.strategies[0].outcome) == ((("GAIN", "0.5"), ("albedo", "0.8")), "fail")
    assert drawn


def test_a_shader_that_lacks_a_parameter_is_told_of(harness: Harness, albedo: Path, no_renderer: None) -> None:
    shader = ByScene("shader", str(albedo.with_suffix(".frag")))
    axes = parse_axes(["albedo=0.2,0.8", "rho=1,2", "once=1"])
    assert list(notes(["mixture", shader], SceneFile(albedo), axes)) == [
        "note: 'ball' has no uniform, constant or macro 'rho', and is the same at all its values"]
    said = refusal(harness("study", albedo, *BALL, "--shader", shader.word, "--set", "rho=1"))
    assert f"{albedo}: no parameter 'rho'; it declares albedo; 'ball' has albedo, GAIN, numpass: write" in said


def test_costs_are_told_and_what_was_not_reached_is_said_so(harness: Harness, tinted: Path,
                                                            monkeypatch: pytest.MonkeyPatch) -> None:
    made = study(line("uniform", error=0.8), line("mixture", error=0.2), error=0.02)
    monkeypatch.setattr("harness.studies.product.study", lambda *arguments, **options: made)
    done = harness("study", tinted, *BRIEF, "-s", "mixture", "--error", 0.02)
    rows = {words[0]: words for text in done.out.splitlines()
            if (words := text.split()) and words[0] in ("uniform", "mixture") and words[1] == "0.01"}
    assert rows["uniform"][2].endswith("*") and rows["mixture"][2].endswith("*")
    assert "* not measured: the curve does not come to this error" in done.out
    answer = harness("study", tinted, *BRIEF, "-s", "mixture", "--error", 0.02, "--json").json
    assert answer["rmse_to_reach"] == pytest.approx(0.01)
    assert answer["strategies"][0]["samples_to_rmse"]["extrapolated"] == "above"


class TestCompareStudies:
    """Two folders."""

    @pytest.fixture(autouse=True)
    def kept(self) -> None:
        good = line("mixture", seed=1)
        for name, lines in {"before": (good, line("uniform", seed=2)), "same": (line("mixture", seed=3),),
                            "worse": (line("mixture", seed=4, error=1.5), line("nee", seed=5))}.items():
            product = StudyProduct((), (study(*lines),))
            kept = Kept(name, product=False)
            kept.add(product.studies[0])
            kept.finish(product)

    def test_that_agree_end_in_0(self, harness: Harness) -> None:
        done = harness("compare-studies", "before", "same")
        assert done.status == 0 and "not distinguishable" in done.out and "ball uniform  only in A" in done.out
        assert "2 cells: 1 not distinguishable, 1 only in A" in done.out

    def test_of_which_one_is_worse_end_in_1(self, harness: Harness) -> None:
        done = harness("compare-studies", "before", "worse")
        assert done.status == 1
        assert "ball mixture: rmse got worse" in done.out and "changed, worse" in done.out
        answer = harness("compare-studies", "before", "worse", "--json").json
        assert answer["worse"] and {cell["estimator"]: cell["verdict"] for cell in answer["cells"]} == {
            "mixture": "changed", "uniform": "only in A", "nee": "only in B"}
        rmse = next(change for change in answer["cells"][0]["changes"] if change["quantity"] == "rmse")
        assert rmse["low"] < 1.5 < rmse["high"] and rmse["worse"]
        assert harness("compare-studies", "worse", "before").status == 0

    def test_that_are_none_are_refused(self, harness: Harness) -> None:
        assert "no such study; run 'harness study' first" in refusal(harness("compare-studies", "before", "gone"))
        path = Path("same/study.json")
        path.write_text(json.dumps({**json.loads(path.read_text()), "format": 1}))
        assert "format 1 of a study" in refusal(harness("compare-studies", "before", "same"))
        other = StudyProduct((), (replace(study(line("uniform", scene="plates"))),))
        kept = Kept("other", product=False)
        kept.add(other.studies[0])
        kept.finish(other)
        assert "no cell in common" in refusal(harness("compare-studies", "before", "other"))
