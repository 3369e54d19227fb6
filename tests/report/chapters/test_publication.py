"""The chapters that make the report a publication: abstract, French page, method, features, deviates, limits."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.report import Inputs, formats, texts
from harness.report.blocks import Curves, Heading, Paragraph, Pictures, Remarks, Table
from harness.report.chapters import abstract, deviates, features, gains, limits, method, references, resume, speed
from harness.report.figures.deviates import pixel_deviates
from harness.report.headline import headline
from harness.report.texts import FOLDER, filled, prose, read, works
from harness.results import FeatureImage, KillRecord, StudyResult
from tests.support.blocks import blocks
from tests.support.report import DEVICE, noisy, with_measured

ROOT = Path(__file__).parents[3]


def told(study: StudyResult) -> str:
    """The abstract, with ordinary spaces."""
    chapter, = abstract.chapters(Inputs([study], "quick"))
    return blocks(chapter, Paragraph)[0].text.replace(formats.NBSP, " ")


def outcome(study: StudyResult, first: str) -> StudyResult:
    """The study with the outcome of the first strategy's mean replaced, all others passing."""
    verdicts = [first, *["pass"] * (len(study.strategies) - 1)]
    return dataclasses.replace(study, strategies=tuple(
        dataclasses.replace(each, verdict=dataclasses.replace(each.verdict, outcome=verdict))  # type: ignore[arg-type]
        for each, verdict in zip(study.strategies, verdicts, strict=True)))


def test_the_abstract_claims_what_the_verdicts_say(study: StudyResult) -> None:
    assert "All 4 pairs agree" in told(outcome(study, "pass"))
    assert "none differs from the reference, and 3 are shown to agree" in told(outcome(study, "inconclusive"))
    assert "The tracer is not right everywhere: of the 4 pairs 1 differ" in told(outcome(study, "fail"))


def test_what_was_not_measured_is_not_told_in_either_language(study: StudyResult) -> None:
    alone, more = Inputs([study], "quick"), Inputs([study], "quick", mutants=KillRecord((), (), (), (), ()))
    assert "mutants" not in headline(alone) and "mutants" in headline(more)
    french = [str(next(resume.chapters(inputs)).blocks) for inputs in (alone, more)]
    assert "défauts d’une ligne" not in french[0] and "défauts d’une ligne" in french[1]


def test_every_sentence_has_its_numbers_in_both_languages(study: StudyResult) -> None:
    """Of inputs in which everything was measured, by their counts alone."""
    some: Any = SimpleNamespace
    slow = with_measured(study.strategies[0], seconds_per_spp=9.0)
    lights = [dataclasses.replace(study.strategies[-1], strategy=name) for name in ("mis", "mis sobol")]
    everything = Inputs(
        [dataclasses.replace(study, strategies=(slow, *study.strategies[1:], *lights))], "quick",
        coupled=(some(scene="spheres", strategy="mixture", ratio=5.0, error=(1e-6, 0, 0)),), exhibits=(some(),),
        calibration=some(suite=some(runs=1000, failed=3, gates=(1, 2))), mutants=some(mutants=(1, 2), survivors=(1,)),
        autopsies=some(reached=3, count=lambda outcome: 2), causes=some(records=(some(visible=4, first=3),)),
        bench=some(rows=(some(opponent="path", ratio=6.0),), entrants=(some(best=True, renderer="tracer", ratio=2.0),)))
    found = headline(everything)
    verdicts = {"right", "open", "wrong"}
    assert len(verdicts & found.keys()) == 1 and found["autopsies"] == {"reached": "3", "named": "2"}
    numbers: dict[str, dict[str, str]] = {**dict.fromkeys(verdicts, found[(verdicts & found.keys()).pop()]), **found}
    for each in read("abstract.toml")["sentence"]:
        assert each["part"] in {"what", "how", "results"}
        for language in ("en", "fr"):
            assert filled(each[language], numbers[each["topic"]], "abstract.toml")


def test_the_french_page_says_so_and_prints_numbers_as_french_does(study: StudyResult) -> None:
    chapter, = resume.chapters(Inputs([study], "quick"))
    text = " ".join(block.text for block in blocks(chapter, Paragraph))
    assert chapter.language == "fr" and "±0,2\xa0%" in text and "\xa0;" in text
    assert not re.search(r"\d\.\d| [;:?!]", text)


@pytest.mark.parametrize(("english", "french"), [
    ("12,345.6", "12\u202f345,6"), ("+3.1\xa0% [+1.0,\xa0+9.4]\xa0%", "+3,1\xa0% [+1,0\xa0;\xa0+9,4]\xa0%"),
    ("5.1\xa0×\xa0[4.4,\xa05.9]", "5,1\xa0×\xa0[4,4\xa0;\xa05,9]")])
def test_numbers_in_french(english: str, french: str) -> None:
    assert formats.french(english) == french


def test_every_work_is_cited_and_the_code_follows_it(study: StudyResult) -> None:
    """No decoration: each stands in a text of the report, and in the source of what it is cited for."""
    cited = "".join(path.read_text(encoding="utf-8") for path in FOLDER.iterdir() if path.suffix in (".toml", ".py")
                    and path.name != "references.toml")
    code = "".join(path.read_text(encoding="utf-8") for folder in ("harness", "glsl") for path in
                   (ROOT / folder).rglob("*") if path.suffix in (".py", ".glsl") and FOLDER not in path.parents)
    for work in read("references.toml")["work"]:
        assert f"[{work['id']}]" in cited, f"no text cites {work['id']}"
        assert work["code"] in code, f"nothing in the code says '{work['code']}'"
    assert len(works()) == len(read("references.toml")["work"])


def test_citations_are_numbers_that_lead_to_their_works(study: StudyResult) -> None:
    inputs = Inputs([study], "quick")
    chapter, = method.chapters(inputs)
    listed, = next(references.chapters(inputs)).blocks
    anchors = {f"[{work.number}]": work.anchor for work in listed.items}  # type: ignore[union-attr]
    links = [link for block in blocks(chapter, Paragraph) for link in block.links]
    assert len(links) > 15 and all(anchors[link.words] == link.target for link in links)
    assert not re.search(r"\[[a-z]+\d{4}\]", str(chapter.blocks))


def test_a_gap_and_a_work_that_nobody_knows_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(texts, "FOLDER", tmp_path)
    (tmp_path / "references.toml").write_text("work = []")
    (tmp_path / "gap.toml").write_text('[[block]]\ntext = "so {many}"')
    (tmp_path / "cite.toml").write_text('[[block]]\ntext = "as in [nobody1999]"')
    works.cache_clear()
    with pytest.raises(HarnessError, match=r"gap\.toml has a gap \{many\}"):
        list(prose("gap.toml", {}))
    with pytest.raises(HarnessError, match="cites 'nobody1999', which is not among the works"):
        list(prose("cite.toml", {}))
    works.cache_clear()


def test_features_are_shown_where_their_scenes_were_studied(study: StudyResult) -> None:
    chapter, = features.chapters(Inputs([study], "quick"))
    rows = [row for figure in blocks(chapter, Pictures) for row in figure.rows]
    assert [row.title.partition(":")[0] for row in rows] == ["Antialiasing", "Importance sampling"]
    assert [picture.title.partition(",")[0] for picture in rows[0].pictures] == [
        "spheres", "mixture", "Reference", "Difference"]
    assert [picture.title.partition(",")[0] for picture in rows[1].pictures[1:]] == ["uniform", "mixture", "Reference"]
    assert not list(features.chapters(Inputs([dataclasses.replace(study, scene="mine")], "quick")))


def test_a_feature_stands_beside_the_scene_without_it_and_strategies_have_equal_samples(study: StudyResult) -> None:
    assert features.sides_of("spheres") == ("footprint", "uniform", "mixture") and not features.sides_of("mine")
    shape = study.reference.mean.shape
    drawn = [FeatureImage("spheres", side, number, np.full(shape, 0.1 * number))
             for number, side in enumerate(("footprint", "uniform", "mixture"), 1)]
    chapter, = features.chapters(Inputs([study], "quick", features=drawn))
    first, second = [row for figure in blocks(chapter, Pictures) for row in figure.rows]
    mixture = next(one for one in study.strategies if one.strategy == "mixture")
    assert [picture.title for picture in first.pictures] == [
        "spheres", "One ray", f"mixture, {mixture.estimate.samples}\u00a0spp", "Reference", "Difference"]
    assert [picture.title for picture in second.pictures] == [
        "spheres", "uniform, 2\u00a0spp", "mixture, 3\u00a0spp", "Reference"]
    figure = blocks(chapter, Pictures)[0]
    assert "Pictures without a feature are of 1 samples." in figure.caption
    files = [picture.file.name for row in (first, second) for picture in row.pictures]
    assert len(set(files)) == len(files)


def test_every_feature_is_left_out_of_something_or_told_by_two_strategies() -> None:
    for feature in read("features.toml")["feature"]:
        assert ("without" in feature) == ("title" in feature) != ("strategies" in feature), feature


def test_every_feature_names_a_bundled_scene_and_a_part_of_it() -> None:
    for feature in read("features.toml")["feature"]:
        assert (ROOT / "mitsuba_scenes" / f"{feature['scene']}.xml").exists(), feature
        left, top, width, height = feature["crop"]
        assert min(feature["crop"]) >= 0 and left + width <= 1.001 and top + height <= 1.001, feature


def test_a_crop_is_inside_the_image_and_never_empty() -> None:
    crop = features.Crop.of([0.9, 0.99, 0.5, 0.001], (30, 40, 3))
    assert crop == features.Crop(36, 29, 40, 30)
    assert crop.cut(np.zeros((30, 40, 3))).shape == (1, 4, 3)


def test_deviates_of_a_right_render_are_normal_and_those_of_a_wrong_one_are_not(study: StudyResult) -> None:
    truth = np.full((64, 64, 3), 0.5)
    reference = noisy(truth, 4096, 0.3, np.random.default_rng(1), batches=64)
    right, wrong = (pixel_deviates(dataclasses.replace(study, reference=reference), dataclasses.replace(
        study.strategies[0], estimate=noisy(truth, 1024, 0.5, np.random.default_rng(2), bias, batches=32)))
        for bias in (0.0, 0.05))
    assert right.z.size == 4096 and abs(right.spread - 1) < 0.04 and abs(right.z.mean()) < 0.06
    assert abs(right.beyond(2.0) - 0.0455) < 0.012
    assert wrong.z.mean() > 1


def test_pixels_without_noise_have_no_deviate(exact: StudyResult) -> None:
    assert pixel_deviates(exact, exact.strategies[1]).z.size == 0
    chapter, = deviates.chapters(Inputs([exact], "quick"))
    figure, = blocks(chapter, Curves)
    assert b"furnace_convex, uniform" in figure.file.content, "of the least noisy strategy that has noise"
    silent = dataclasses.replace(exact, strategies=exact.strategies[1:])
    assert not list(deviates.chapters(Inputs([silent], "quick")))


def test_gains_are_shown_of_scenes_with_two_slopes(study: StudyResult, exact: StudyResult) -> None:
    """Of every strategy but the baseline, with the extremes by scene; one slope alone has nothing to gain."""
    chapter, = gains.chapters(Inputs([study, exact], "quick"))
    table, = blocks(chapter, Table)
    assert [row[0].text for row in table.rows] == ["cosine", "lobes", "mixture"]
    assert all(row[1].text == "1" and row[3].text.endswith("(spheres)") for row in table.rows)
    figure, = blocks(chapter, Curves)
    assert b"spheres" in figure.file.content and b"furnace_convex" not in figure.file.content
    assert not list(gains.chapters(Inputs([exact], "quick")))


def test_the_page_of_limits_names_the_commands_of_what_was_not_measured(study: StudyResult) -> None:
    without, = limits.chapters(Inputs([study], "quick"))
    assert blocks(without, Heading)[-1].title == "Not measured for this report"
    remarks = [remark.text for remark in blocks(without, Remarks)[-1].items]
    assert "How often the verdicts err: harness calibrate." in remarks
    with_mutants, = limits.chapters(Inputs([study], "quick", mutants=KillRecord((), (), (), (), ())))
    assert len(blocks(with_mutants, Remarks)[-1].items) == len(remarks) - 1


def test_speed_is_told_by_device_and_never_across(study: StudyResult) -> None:
    """Each device has its rows, the reference's last; what two devices drew together has none."""
    first, second, *rest = study.strategies
    elsewhere = with_measured(second, device="another")
    mixed = [with_measured(each, device="") for each in rest]
    changed = dataclasses.replace(study, strategies=(first, elsewhere, *mixed))
    table = blocks(next(speed.chapters(Inputs([changed], "quick"))), Table)[-1]
    rate = study.reference.mean[..., 0].size / first.seconds_per_spp / 1e6
    assert [cell.text for cell in table.rows[0]][:4] == [
        DEVICE, f"tracer, {first.strategy}", "1", formats.significant(rate, 3)]
    assert [[cell.text for cell in row][:2] for row in table.rows[1:]] == [
        ["reference, Mitsuba", "1"], ["another", f"tracer, {second.strategy}"]]
    assert table.rules == (0, 2)
