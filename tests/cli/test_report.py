"""`harness report`: from scene files to a PDF, read back the second time, whatever happened to the cache meanwhile."""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from harness import bench, files, studies
from harness.cli import main
from harness.errors import SceneError
from harness.policy import fail_level
from harness.report import Inputs
from harness.results import Benchmark, StudyResult
from harness.studies.storage import load_study
from tests.cli.conftest import SKY, Harness

ROW = bench.BenchRow("diffuse", "cosine", "path", "compute", needed=5.0, tracer_rate=12.0, opponent_rate=2.0, ratio=6.0,
                low=5.5, high=6.5, wall_ratio=6.1, efficiency_ratio=4.0)


TINY = studies.Profile(spp=4, replicas=2, reference_spp=8)


@pytest.fixture(autouse=True)
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(studies.PROFILES, "quick", TINY)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The cache that a report on the sky leaves: most tests begin with a copy of it."""
    folder = tmp_path_factory.mktemp("drawn")
    (folder / "sky.xml").write_text(SKY, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("HARNESS_CACHE", str(folder / "cache"))
        patch.setitem(studies.PROFILES, "quick", TINY)
        patch.setattr("harness.report.build_report", lambda inputs, output: output / "report.pdf")
        assert main(["report", "sky.xml", "-o", "out"]) == 0
    return folder / "cache"


@pytest.fixture
def warm(drawn: Path, tmp_path: Path) -> Path:
    """A cache that knows the sky, of this test alone."""
    return Path(shutil.copytree(drawn, tmp_path / "cache"))


@pytest.fixture
def honest(warm: Path) -> StudyResult:
    """The study of the sky; the cache has its samples, but forgot that it was made."""
    folder, = (warm / "studies").iterdir()
    result = load_study(folder)
    shutil.rmtree(folder)
    return result


@pytest.fixture
def unset(monkeypatch: pytest.MonkeyPatch) -> list[Inputs]:
    """Reports are not set, which takes seconds, but noted here."""
    built: list[Inputs] = []

    def note(inputs: Inputs, output: Path) -> Path:
        built.append(inputs)
        return output / "report.pdf"

    monkeypatch.setattr("harness.report.build_report", note)
    return built


def test_from_a_scene_file_to_a_pdf_and_the_second_time_without_a_renderer(
    harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a scene whose name the chapter on features knows."""
    bench.save(Benchmark((ROW,)), Path("out/bench.json"))
    scene = sky.rename(sky.with_name("spheres.xml"))
    first = harness("report", scene, "-o", "out")

    def refuse(*arguments: object, **options: object) -> None:
        raise AssertionError("a renderer was made")

    for name in ("tracer.TracerRenderer", "mitsuba.ReferenceRenderer", "coupled.CoupledRenderer"):
        name = f"harness.estimators.{name}"
        monkeypatch.setattr(name, refuse)
    second = harness("report", scene, "-o", "elsewhere")
    for done, folder in ((first, "out"), (second, "elsewhere")):
        assert (done.status, done.err) == (0, "")
        lines = done.out.splitlines()
        assert lines[0].startswith("6 of 6 pairs of scene and strategy pass; ")
        assert lines[-1] == f"{folder}/report.pdf"
        assert Path(folder, "report.pdf").read_bytes().startswith(b"%PDF-")
        page = Path(folder, "report.html").read_text(encoding="utf-8")
        assert "Nothing but sky." in page and "One ray" in page and "uniform, 16\u00a0spp" in page
    pages = [json.loads(Path(folder, "report.json").read_text("utf-8"))["chapters"] for folder in ("out", "elsewhere")]
    beside, without = (chapter["blocks"][0]["rows"][0][0]["text"] for page in pages for chapter in page
                       if chapter["title"] == "Speed")
    assert beside == "diffuse" != without, "the benchmark beside the report is taken up"


def test_json_names_every_verdict(harness: Harness, sky: Path, warm: Path, unset: list[Inputs]) -> None:
    done = harness("report", sky, "-o", "out", "--json")
    assert done.json["pdf"] == "out/report.pdf"
    assert done.json["verdicts"] == {
        f"sky {name}": "pass" for name in ("uniform", "cosine", "phong", "lobes", "mixture", "mixture sobol")}


class TestCache:
    """What was studied is read back, and what was lost of it is made again."""

    @pytest.fixture
    def kept(self, warm: Path) -> Path:
        """The folder of a study in the cache."""
        folder, = (warm / "studies").iterdir()
        return folder

    def test_another_exposure_is_another_study_of_the_same_samples(
        self, harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch, warm: Path, unset: list[Inputs],
    ) -> None:
        harness("report", sky, "-o", "out")

        def refuse(*arguments: object) -> None:
            raise AssertionError("rendered again")

        for name in ("gpu.renderer.TracerRenderer", "reference.renderer.ReferenceRenderer"):
            monkeypatch.setattr(f"harness.{name}.render_batch", refuse)
        sky.write_text(SKY.replace('value="-1"', 'value="1"'))
        harness("report", sky, "-o", "out")
        assert [built.results[0].exposure for built in unset] == [-1, 1]

    @pytest.mark.parametrize("damage", ["", '{"format": 1}'])
    def test_a_damaged_study_is_made_again(
        self, harness: Harness, sky: Path, kept: Path, unset: list[Inputs], damage: str,
    ) -> None:
        file = kept / "study.json"
        whole = json.loads(file.read_text(encoding="utf-8"))
        file.write_text(damage, encoding="utf-8")
        done = harness("report", sky, "-o", "out")
        assert done.status == 0
        assert done.err.startswith(f"warning: {file}: ")
        assert done.err.endswith("; the study is made again\n")
        assert done.err.count("\n") == 1
        assert json.loads(file.read_text(encoding="utf-8")) == whole
        assert harness("report", sky, "-o", "out").err == ""

    def test_a_missing_image_is_made_again(
        self, harness: Harness, sky: Path, kept: Path, unset: list[Inputs],
    ) -> None:
        image, = kept.glob("reference.*.exr")
        image.unlink()
        done = harness("report", sky, "-o", "out")
        assert done.status == 0
        assert done.err == f"warning: {image}: no such file; the study is made again\n"
        assert image.exists()


def test_a_verdict_that_is_not_pass_is_named_and_makes_the_status_1(
    harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch, honest: StudyResult, unset: list[Inputs],
) -> None:
    def biased(*arguments: object, **options: object) -> StudyResult:
        items = [dataclasses.replace(item, verdict=dataclasses.replace(item.verdict, outcome=outcome), suits=suits)
                 for item, outcome, suits in zip(
                     honest.strategies, ("fail", "inconclusive", "fail", "pass", "pass", "pass"),
                     (True, True, False, True, True, True), strict=True)]
        return dataclasses.replace(honest, strategies=tuple(items))

    monkeypatch.setattr("harness.studies.memo.study", biased)
    done = harness("report", sky, "-o", "out")
    assert done.status == 1
    assert done.err == "warning: sky uniform: fail\nwarning: sky cosine: inconclusive\n"
    assert done.out.splitlines()[0].startswith("3 of 5 pairs of scene and strategy pass; ")
    assert done.out.splitlines()[-1] == "out/report.pdf"


def test_a_tile_that_fails_makes_the_status_1_and_an_undecided_one_does_not(
    harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch, honest: StudyResult, unset: list[Inputs],
) -> None:
    def spoilt(*arguments: object, **options: object) -> StudyResult:
        items = []
        for item, outcome in zip(honest.strategies, ("fail", "inconclusive", "pass", "pass", "pass", "pass"),
                                 strict=True):
            tiles = dataclasses.replace(item.tiles, fine=dataclasses.replace(item.tiles.fine, outcome=outcome))
            items.append(dataclasses.replace(item, tiles=tiles))
        return dataclasses.replace(honest, strategies=tuple(items))

    monkeypatch.setattr("harness.studies.memo.study", spoilt)
    done = harness("report", sky, "-o", "out", "--json")
    assert done.status == 1
    assert done.err == "warning: sky uniform: fail in tiles\n"
    assert [done.json["verdicts"][f"sky {name}"] for name in ("uniform", "cosine")] == ["fail", "pass"]


def test_all_scenes_of_a_report_share_the_rate_of_false_alarms(
    harness: Harness, sky: Path, warm: Path, unset: list[Inputs],
) -> None:
    """Six lines a scene; with a second scene each has half the level, also where the first is in the cache."""
    other = sky.with_name("other.xml")
    other.write_text(SKY, encoding="utf-8")
    harness("report", sky, "-o", "out")
    harness("report", sky, other, "-o", "out")
    levels = [{item.tiles.fine.fail_level for result in built.results for item in result.strategies}
              for built in unset]
    assert levels == [{fail_level(6)}, {fail_level(12)}]


@pytest.mark.parametrize("content", ["", '{"rows": [{"scene": "x"}]}'])
@pytest.mark.parametrize(("name", "kind"), [
    ("bench", "a benchmark result"), ("calibration", "a calibration"), ("mutants", "a kill matrix"),
    ("autopsies", "a table of autopsies")])
def test_what_is_damaged_beside_the_report_is_left_out_with_a_warning(
    harness: Harness, sky: Path, warm: Path, unset: list[Inputs], name: str, kind: str, content: str,
) -> None:
    Path("out").mkdir()
    Path(f"out/{name}.json").write_text(content)
    done = harness("report", sky, "-o", "out")
    assert done.status == 0
    assert done.err.startswith(f"warning: out/{name}.json: not {kind} (") and done.err.count("\n") == 1
    assert done.err.endswith("; the report goes without it\n")
    assert not getattr(unset[0], name)


class TestCoupled:
    """Every scene of a report is compared with the oracle that draws its random numbers, once."""

    def test_records_are_kept_and_damaged_ones_measured_again(
        self, harness: Harness, sky: Path, warm: Path, unset: list[Inputs],
    ) -> None:
        assert harness("report", sky, "-o", "out").status == 0
        file, = (warm / "coupled").glob("*/coupled.npz")
        file.write_bytes(b"")
        done = harness("report", sky, "-o", "out")
        assert done.err.startswith(f"warning: {file}: missing or damaged (")
        assert done.err.endswith("; the coupled images are drawn again\n") and done.err.count("\n") == 1
        for built in unset:
            assert [(record.scene, record.strategy, record.differing) for record in built.coupled] == [
                ("sky", "mixture", 0), ("sky", "uniform", 0)]

    def test_a_scene_that_the_oracle_cannot_follow_is_left_out_with_a_word(
        self, harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch, warm: Path, unset: list[Inputs],
    ) -> None:
        shutil.rmtree(warm / "coupled")

        def refuse(*arguments: object) -> None:
            raise SceneError("sky.xml: too far")

        monkeypatch.setattr("harness.studies.coupled.measure_coupled", refuse)
        done = harness("report", sky, "-o", "out")
        assert done.status == 0 and not unset[0].coupled
        assert done.err == "warning: sky.xml: too far; the report does not compare its paths\n"


class TestExhibits:
    """The handout's errors belong to the report on the scenes that come with the harness."""

    @pytest.fixture
    def measured(self, monkeypatch: pytest.MonkeyPatch, sky: Path, warm: Path) -> list[int]:
        """The bundled scenes are one, the exhibits are none and counted, and reports keep what they are given."""
        calls: list[int] = []

        def measure(*arguments: object) -> tuple[()]:
            calls.append(1)
            return ()

        monkeypatch.setattr("harness.course.memo.measure_exhibits", measure)
        folder = sky.parent / "scenes"
        folder.mkdir()
        sky.rename(folder / "sky.xml")
        real = files.data_dir
        monkeypatch.setattr(files, "data_dir", lambda name: folder if name == "mitsuba_scenes" else real(name))
        return calls

    def test_they_are_measured_once_and_read_back(
        self, harness: Harness, measured: list[int], unset: list[Inputs],
    ) -> None:
        assert harness("report", "-o", "out").status == 0
        assert harness("report", "-o", "out").status == 0
        assert len(measured) == 1

    def test_damaged_ones_are_measured_again(
        self, harness: Harness, measured: list[int], tmp_path: Path, unset: list[Inputs],
    ) -> None:
        harness("report", "-o", "out")
        words, = (tmp_path / "cache" / "exhibits").glob("*/exhibits.json")
        words.write_text("{", encoding="utf-8")
        done = harness("report", "-o", "out")
        assert done.err.startswith(f"warning: {words}: not exhibits of the handout (")
        assert done.err.endswith("; the exhibits are measured again\n") and done.err.count("\n") == 1
        assert len(measured) == 2

    def test_a_report_on_other_scenes_goes_without(
        self, harness: Harness, measured: list[int], tmp_path: Path, unset: list[Inputs],
    ) -> None:
        assert harness("report", tmp_path / "scenes" / "sky.xml", "-o", "out").status == 0
        assert not measured and not unset[0].exhibits
