"""Products of studies: every combination one study, one family of verdicts, one table; kept, and read back."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError, SceneError, StoreError
from harness.results import StudyResult
from harness.samples.estimate import Estimate
from harness.scene import SceneFile
from harness.studies.kept import Kept, folder_name, load_studies
from harness.studies.parameters import parse_axes
from harness.studies.product import StudyProduct, study_product, without_pixels
from harness.studies.remaining import Left, Schedule
from tests.support.fakes import NoiseRenderer
from tests.support.gates import SKY
from tests.support.studies import line, study

EXACT = Estimate.exact(np.full((12, 16, 3), 0.5))


@dataclass(frozen=True)
class Noise:
    """Normal noise about 0.5, as large as the scene's parameter says."""

    name: str = "noise"

    def check(self, scene: SceneFile) -> str:
        return ""

    @contextmanager
    def open(self, scene: SceneFile) -> Iterator[NoiseRenderer]:
        yield NoiseRenderer(sigma=float(dict(scene.parameters)["sigma"]), size=(12, 16))


@pytest.fixture
def scene(tmp_path: Path) -> SceneFile:
    path = tmp_path / "sky.xml"
    path.write_text(SKY.replace("<integrator", '<default name="sigma" value="1"/><default name="tint" value="0.5"/>'
                                "<integrator").replace('"0.5, 0.5, 0.5"', '"$tint"').replace(
        "<film", '<string name="note" value="$sigma"/><film'), encoding="utf-8")
    return SceneFile(path, size=(16, 12))


def made(scene: SceneFile, **options: object) -> StudyProduct:
    given: dict[str, object] = {"axes": parse_axes(["sigma=0.1,0.2", "tint=0.5,0.6"]), "spp": 8, "replicas": 4,
                                "reference": EXACT, "tolerance": 0.2, "samplers": ("independent",)}
    return study_product([scene], [Noise(), Noise("other")], **{**given, **options})  # type: ignore[arg-type]


def test_every_combination_is_a_study_with_rows_of_its_own(scene: SceneFile) -> None:
    product = made(scene)
    assert [each.cell[1] for each in product.studies] == [
        (("sigma", sigma), ("tint", tint)) for sigma in ("0.1", "0.2") for tint in ("0.5", "0.6")]
    assert product.varied == ("sigma", "tint") and product.good
    rows = list(product.records())
    errors = [row.value for sigma in ("0.1", "0.2") for row in rows if row.quantity == "rmse" and row.samples == 8
              and dict(row.parameters) == {"sigma": sigma, "tint": "0.5"} and row.estimator == "noise"]
    assert len(errors) == 8
    assert errors[4:] == pytest.approx([2 * error for error in errors[:4]], rel=1e-3)  # the same numbers, twice as far


def test_all_verdicts_share_one_rate_of_false_alarms(scene: SceneFile) -> None:
    level, = {item.tiles.fine.fail_level for each in made(scene).studies for item in each.strategies}
    assert level == pytest.approx(0.01 / (3 * 8), rel=0.01)


def test_each_study_is_handed_over_with_its_images_and_then_held_without(scene: SceneFile) -> None:
    kept: list[StudyResult] = []
    product = made(scene, keep=kept.append)
    assert [each.reference.mean.shape for each in kept] == [(12, 16, 3)] * 4
    assert {item.estimate.mean.size for each in product.studies for item in each.strategies} == {0}
    whole, slim = kept[0].strategies[0].estimate, product.studies[0].strategies[0].estimate
    np.testing.assert_array_equal(whole.image_variance, slim.image_variance)
    assert (slim.samples, slim.batches) == (whole.samples, whole.batches)


def test_a_name_that_is_wrong_is_told_before_anything_is_rendered(scene: SceneFile) -> None:
    kept: list[StudyResult] = []
    with pytest.raises(SceneError, match="no parameter 'gamma'"):
        made(scene, axes=parse_axes(["gamma=1"]), keep=kept.append)
    with pytest.raises(HarnessError, match="two of the estimators are called 'noise'"):
        study_product([scene], [Noise(), NoiseTwin()], spp=8, keep=kept.append)
    assert not kept


@dataclass(frozen=True)
class NoiseTwin(Noise):
    """Another estimator of the same name."""


def test_the_time_left_counts_the_studies_to_come(scene: SceneFile) -> None:
    """By a clock that goes on by the work that is done: a second for each sample per pixel of the slow one."""
    class Turned:
        now = 0.0

        def __call__(self) -> float:
            Turned.now += 0.3
            return Turned.now

    told: list[Left] = []
    made(scene, schedule=Schedule(told.append, Turned()))
    assert len(told) > 100
    seconds = [left.seconds for left in told]
    assert seconds[0] > seconds[len(seconds) // 2] > seconds[-1] and seconds[-1] < 1
    elapsed = Turned.now
    assert seconds[len(seconds) // 2] == pytest.approx(elapsed / 2, rel=0.2)


class TestKept:
    """In a folder."""

    @pytest.fixture
    def product(self) -> StudyProduct:
        axes = (("alpha", ("1", "10")),)
        return StudyProduct(axes, tuple(study(line("uniform", parameters=(("alpha", alpha),), seed=seed), error=0.1)
                                        for seed, alpha in enumerate(axes[0][1])))

    def keep(self, product: StudyProduct, folder: Path) -> None:
        kept = Kept(folder, product=len(product.studies) > 1)
        for each in product.studies:
            kept.add(each)
        kept.finish(product)

    def test_comes_back_as_it_was(self, product: StudyProduct, tmp_path: Path) -> None:
        self.keep(product, tmp_path / "here")
        found = load_studies(tmp_path / "here")
        assert found.axes == product.axes
        assert list(found.records()) == list(product.records())
        assert {each.error for each in found.studies} == {0.1}
        assert sorted(path.name for path in (tmp_path / "here").iterdir()) == [
            "ball_alpha=1", "ball_alpha=10", "product.json", "table.csv", "table.parquet"]

    def test_of_one_study_is_that_study(self, product: StudyProduct, tmp_path: Path) -> None:
        single = StudyProduct((("alpha", ("1",)),), product.studies[:1])
        self.keep(single, tmp_path)
        assert (tmp_path / "study.json").is_file()
        assert list(load_studies(tmp_path).records()) == list(single.records())

    def test_leaves_nothing_of_what_was_there_before(self, product: StudyProduct, tmp_path: Path) -> None:
        self.keep(product, tmp_path)
        (tmp_path / "ball_alpha=10" / "notes.txt").write_text("mine", encoding="utf-8")
        fewer = StudyProduct((("alpha", ("1", "20")),), (product.studies[0], study(
            line("uniform", parameters=(("alpha", "20"),)))))
        self.keep(fewer, tmp_path)
        assert [each.cell[1][0][1] for each in load_studies(tmp_path).studies] == ["1", "20"]
        assert [path.name for path in (tmp_path / "ball_alpha=10").iterdir()] == ["notes.txt"]
        self.keep(StudyProduct((), product.studies[:1]), tmp_path)
        assert not (tmp_path / "product.json").exists()
        self.keep(product, tmp_path)
        assert not (tmp_path / "study.json").exists() and len(load_studies(tmp_path).studies) == 2

    @pytest.mark.parametrize(("changed", "message"), [
        ({"format": 0}, "format 0 of a product of studies, this version reads 1"),
        ({"studies": ["../elsewhere"]}, "a study that lies elsewhere"),
        ({"studies": ["gone"]}, "no such study"),
        ({"axes": 3}, "not a product of studies"),
    ])
    def test_that_is_damaged_is_refused_in_one_line(self, product: StudyProduct, tmp_path: Path,
                                                    changed: dict[str, object], message: str) -> None:
        self.keep(product, tmp_path)
        path = tmp_path / "product.json"
        path.write_text(json.dumps({**json.loads(path.read_text()), **changed}))
        with pytest.raises(StoreError, match=message) as caught:
            load_studies(tmp_path)
        assert "\n" not in str(caught.value)

    def test_has_a_name_of_its_own_for_every_value(self) -> None:
        names = [folder_name(study(line("uniform", parameters=(("kd", value),))))
                 for value in ("1 0 0", "1_0_0", "1/0/0", "x" * 300, "x" * 301, "..")]
        assert names[1] == "ball_kd=1_0_0" and names[-1] == "ball_kd=.."
        assert len(set(names)) == 6 and all(len(name) < 130 and "/" not in name for name in names)


def test_without_pixels_a_study_has_the_same_table() -> None:
    whole = study(line("uniform"))
    assert list(StudyProduct((), (whole,)).records()) == list(StudyProduct((), (without_pixels(whole),)).records())
    assert without_pixels(whole).brightness == whole.brightness
