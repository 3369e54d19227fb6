"""The summary and the verdict table say what the data say, and claim nothing that they do not."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from PIL import Image

from harness.report.blocks import Pictures, Remark, Remarks, Table
from harness.report.chapters.scenes import scene_chapter
from harness.report.chapters.summary import summary
from harness.report.formats import MINUS, NBSP
from harness.report.tables import accuracy_table, slope_mark, verdict_table
from harness.report.tiles import tiles_table
from harness.results import StrategyResult, StudyResult
from harness.stats.findings import Tiles
from tests.support.blocks import blocks
from tests.support.report import with_measured


def with_outcomes(study: StudyResult, **outcomes: str) -> StudyResult:
    """The study with the outcomes of the named strategies replaced; all others pass, with the same errors."""
    def changed(strategy: StrategyResult) -> StrategyResult:
        outcome: Any = outcomes.get(strategy.strategy, "pass")
        return replace(strategy, verdict=replace(strategy.verdict, outcome=outcome))
    return replace(study, strategies=tuple(changed(strategy) for strategy in study.strategies))


def said(remarks: tuple[Remark, ...], mark: str) -> list[str]:
    """The texts of all remarks with a mark, no-break spaces as spaces."""
    return [remark.text.replace(NBSP, " ") for remark in remarks if remark.mark == mark]


def cells(table: Table, row: int) -> list[str]:
    return [cell.text.replace(NBSP, " ") for cell in table.rows[row]]


def test_agreement_is_claimed_for_what_was_judged_only(study: StudyResult) -> None:
    found = summary([with_outcomes(study)])
    assert said(found, "pass")[0] == ("All 4 pairs of strategy and scene over 1 scene agree with the reference within "
                                      "±0.2 % in the mean of every colour channel.")
    assert said(found, "fail") == []
    assert said(found, "warning") == ["Not judged: 1 pair whose strategy does not suit the scene (spheres with phong); "
                                      "the scene's pages say why."]


def test_failures_and_open_questions_come_first_and_by_name(study: StudyResult, synthetic: ModuleType) -> None:
    other = replace(with_outcomes(synthetic.study_result(unsuited=False), lobes="inconclusive"), scene="cornell")
    found = summary([with_outcomes(study, cosine="fail"), other])
    assert found[0].mark == "fail" and found[1].mark == "inconclusive" and found[2].mark == "pass"
    assert said(found, "fail") == ["1 of 8 pairs of strategy and scene over 2 scenes differ from the reference in the "
                                   "mean by more than ±0.2 %: spheres with cosine."]
    assert said(found, "inconclusive")[0].endswith("are undecided in the mean at this number of samples: "
                                                  "cornell with lobes.")
    assert said(found, "pass")[0].startswith("6 of 8 pairs")


def test_a_failing_strategy_that_does_not_suit_is_a_warning(study: StudyResult) -> None:
    found = with_outcomes(study, phong="fail")
    assert said(summary([found]), "fail") == []
    row = next(row for row in verdict_table([found], ["x"]).rows if any(cell.text == "phong" for cell in row))
    assert [cell.mark for cell in row if cell.mark] == ["warning", "warning"]


def test_the_largest_error_is_that_of_a_judged_pair(study: StudyResult) -> None:
    """phong is off by 30 %, but not judged; of the others, lobes is made the worst."""
    worst = study.strategies[3]
    error = np.array([0.0, 0.0, 0.0, -0.0123])
    changed = replace(worst, verdict=replace(worst.verdict, error=error, low=error - 0.002, high=error + 0.002))
    strategies = (*study.strategies[:3], changed, *study.strategies[4:])
    texts = said(summary([replace(study, strategies=strategies)]), "")
    assert "The largest mean error of luminance is −1.230 % ± 0.200 % (spheres, lobes)." in texts


def test_an_unknown_variance_bounds_nothing(study: StudyResult) -> None:
    first = study.strategies[0]
    blind = replace(first, verdict=replace(first.verdict, outcome="inconclusive", low=np.full(4, np.nan),
                                           high=np.full(4, np.nan), smallest_detectable=np.full(4, np.inf)))
    found = summary([replace(study, strategies=(blind, *study.strategies[1:]))])
    assert "Nothing bounds the bias of 1 pair whose variance is unknown: spheres with uniform." in said(
        found, "inconclusive")
    assert any(re.search(r"\(spheres, \w+\) .* a bias of \d.*wherever else the variance is known", text)
               for text in said(found, ""))


def test_the_least_sharp_pair_is_named_with_the_bias_it_would_have_shown(study: StudyResult) -> None:
    def sharp(strategy: StrategyResult, size: float) -> StrategyResult:
        return replace(strategy, verdict=replace(strategy.verdict, smallest_detectable=np.array([0, size, 0, 0.0])))
    strategies = tuple(sharp(s, 0.004 if s.strategy == "cosine" else 0.001) for s in study.strategies)
    assert any(text.startswith("Where the test is least sharp (spheres, cosine) these samples would have revealed a "
                               "bias of 0.400 % with 95 % probability")
               for text in said(summary([replace(study, strategies=strategies)]), ""))


@pytest.mark.parametrize(("slope", "half", "mark", "word"), [
    (-0.5, 0.01, "pass", "yes"), (-0.3, 0.01, "fail", "no"), (-0.48, 0.05, "inconclusive", "not shown")])
def test_slopes_are_judged_against_the_monte_carlo_rate(study: StudyResult, slope: float, half: float,
                                                        mark: str, word: str) -> None:
    """In words of their own: whether a render passes is another question."""
    first = study.strategies[0]
    assert first.slope is not None
    fitted = replace(first, slope=replace(first.slope, slope=slope, low=slope - half, high=slope + half))
    assert slope_mark(fitted) == mark
    found = summary([replace(study, strategies=(fitted,))])
    promised = next(remark for remark in found if remark.text.startswith("RMSE falls"))
    assert promised.mark == mark
    assert ("Not so: spheres with uniform." in promised.text) == (mark == "fail")
    assert ("Not shown: spheres with uniform." in promised.text) == (mark == "inconclusive")
    table = verdict_table([replace(study, strategies=(fitted,))], ["x"])
    assert table.columns[-1].title == f"Slope\n{MINUS}1/2?"
    assert (table.rows[0][-1].text, table.rows[0][-1].mark) == (word, mark)


def test_a_run_without_noise_is_exact_and_one_too_short_to_fit_is_not(exact: StudyResult) -> None:
    cosine = exact.strategies[1]
    assert slope_mark(cosine) == "exact"
    assert any(remark.mark == "exact" for remark in summary([exact]))
    short = with_measured(cosine, spp=cosine.spp[:2],
                          curves={name: curve[:, :2] for name, curve in cosine.curves.items()})
    assert slope_mark(short) == ""
    assert "too few prefixes" in cells(verdict_table([replace(exact, strategies=(short,))], ["x"]), 0)


def test_gains_are_told_with_their_intervals_and_losses_too(study: StudyResult) -> None:
    texts = said(summary([study]), "")
    assert any(text.startswith("At equal error the largest gain is that of mixture over uniform on spheres: samples ")
               and text.count("× [") == 2 for text in texts)
    slow = tuple(with_measured(s, seconds_per_spp=s.seconds_per_spp * (100 if s.strategy == "cosine" else 1))
                 for s in study.strategies)
    assert any(text.startswith("The largest loss is that of cosine over uniform")
               for text in said(summary([replace(study, strategies=slow)]), ""))


def test_what_each_idea_bought_is_one_sentence(study: StudyResult) -> None:
    """Importance sampling over uniform, light sampling over it, even numbers over these; the middle of the scenes."""
    renamed = {"lobes": "mis", "cosine": "mis sobol"}
    lit = replace(study, strategies=tuple(
        replace(s, strategy=renamed.get(s.strategy, s.strategy)) for s in study.strategies))
    told, = [text for text in said(summary([study, lit]), "") if text.startswith("By how much sooner")]
    number = r"[\d.]+"
    assert re.fullmatch(
        f"By how much sooner the same error is reached: importance sampling {number} times \\(the middle of 2 scenes, "
        f"from {number} on spheres to {number} on spheres\\), light sampling {number} times \\(spheres\\) and evenly "
        f"spread numbers {number} times \\(spheres\\)\\.", told), told
    light = float(re.search(r"light sampling ([\d.]+)", told)[1])  # type: ignore[index]  # matched above
    assert 0.3 < light < 1  # lobes are dearer than mixture here, so `mis` loses


def test_samples_that_were_not_finite_are_counted(study: StudyResult) -> None:
    first = study.strategies[0]
    changed = replace(first, estimate=replace(first.estimate, rejected=1234))
    found = replace(study, strategies=(changed, *study.strategies[1:]),
                    reference=replace(study.reference, rejected=1))
    assert "1,235 samples were not finite and were left out." in said(summary([found]), "warning")


def test_the_verdict_table_has_a_row_for_each_pair_and_names_each_scene_once(study: StudyResult,
                                                                            exact: StudyResult) -> None:
    table = verdict_table([study, exact], ["a", "b"])
    assert len(table.rows) == 7 and table.rules == (0, 5)
    assert [(row[0].text, row[0].rows, row[0].target) for row in table.rows if row[0].target] == [
        ("spheres", 5, "a"), ("furnace_convex", 2, "b")]
    for row in table.rows:
        assert len(row) == len(table.columns) - (not row[0].target)


def test_the_accuracy_table_shows_every_channel(study: StudyResult) -> None:
    first = study.strategies[0]
    error = np.array([0.01, 0.02, -0.03, 0.04]) / 100
    verdict = replace(first.verdict, error=error, low=error - 1e-4, high=error + 1e-4)
    table = accuracy_table(replace(study, strategies=(replace(first, verdict=verdict),)))
    assert cells(table, 0)[1:5] == ["+0.010 ± 0.010", "+0.020 ± 0.010", "−0.030 ± 0.010", "+0.040 ± 0.010"]


class TestTiles:
    """What is said of tiles: failures first and by name, and no more than was shown."""

    @staticmethod
    def with_tiles(study: StudyResult, coarse: str, fine: str, strategy: str = "mixture") -> StudyResult:
        """The study with the outcomes of one strategy's tiles replaced; all other tiles pass."""
        def changed(item: StrategyResult) -> StrategyResult:
            outcomes: Any = (coarse, fine) if item.strategy == strategy else ("pass", "pass")
            tiles = (replace(found, outcome=outcome, reason="the tile at x=4, y=2: red -3 % lies outside")
                     for found, outcome in zip((item.tiles.coarse, item.tiles.fine), outcomes, strict=True))
            return replace(item, tiles=Tiles(*tiles))
        return replace(with_outcomes(study), strategies=tuple(map(changed, with_outcomes(study).strategies)))

    @staticmethod
    def reasons(study: StudyResult) -> tuple[Remark, ...]:
        """The verdicts in words, of the scene's own pages."""
        return blocks(scene_chapter(study, "x", "x"), Remarks)[1].items

    def test_a_failure_is_named_in_the_summary_and_told_on_the_scenes_page(self, study: StudyResult) -> None:
        failed = self.with_tiles(study, "fail", "inconclusive")
        assert said(summary([failed]), "fail")[0].startswith(
            "In 1 of 4 pairs some tile differs from the reference by more than its tolerance: spheres with mixture (")
        assert said(self.reasons(failed), "fail") == [
            "mixture, tiles of 8 px: the tile at x=4, y=2: red −3 % lies outside."]

    def test_of_a_strategy_that_does_not_suit_counts_for_nothing(self, study: StudyResult) -> None:
        failed = self.with_tiles(study, "fail", "fail", "phong")
        assert said(summary([failed]), "fail") == []
        assert said(self.reasons(failed), "fail") == []
        row = next(row for row in tiles_table(failed).rows if row[0].text == "phong")
        assert [cell.mark for cell in row if cell.mark] == ["warning"]

    def test_what_is_undecided_is_not_said_to_agree(self, study: StudyResult) -> None:
        found = said(summary([self.with_tiles(study, "pass", "inconclusive")]), "inconclusive")
        assert found[0].startswith("Every larger tile lies within ±1.25 % in 4 of 4 pairs, every smaller one within "
                                   "±5 % in 3. The others are not shown to be right")
        whole = said(summary([self.with_tiles(study, "pass", "pass")]), "pass")
        assert any(text.startswith("Every larger tile") and "The others" not in text for text in whole)

    def test_the_rate_of_false_alarms_is_that_of_all_pairs_together(self, study: StudyResult) -> None:
        """The fixture's level is that of five strategies; four are judged."""
        text, = (text for text in said(summary([with_outcomes(study)]), "") if text.startswith("No tile of any pair"))
        assert "would fail in 0.801 % of such reports at most" in text

    def test_the_table_tells_each_size_of_each_strategy(self, study: StudyResult) -> None:
        table = tiles_table(self.with_tiles(study, "fail", "inconclusive"))
        assert len(table.rows) == 10
        larger, smaller = cells(table, 8), cells(table, 9)
        assert larger[:3] == ["mixture", "8 px, ±1.25 %", "fail"] and smaller[:2] == ["2 px, ±5 %", "inconclusive"]
        assert larger[-1] == "–" and smaller[-1].endswith(" ×")
        fine = study.strategies[-1].tiles.fine
        assert smaller[2] == f"{fine.x}, {fine.y}" and smaller[3].startswith(fine.channel)

    def test_the_overview_has_the_verdicts_side_by_side(self, study: StudyResult) -> None:
        row = verdict_table([self.with_tiles(study, "fail", "inconclusive")], ["x"]).rows[-1]
        assert [(cell.text.replace(NBSP, " "), cell.mark) for cell in row[3:6]] == [
            ("±0.2 %", "pass"), ("±1.25 %", "fail"), ("±5 %", "inconclusive")]

    def test_maps_show_the_deviates_in_place_and_sign(self, study: StudyResult) -> None:
        """A tile at the top right that is too bright is red there."""
        item = study.strategies[-1]
        z = np.zeros_like(item.tiles.fine.z)
        z[0, -1] = item.tiles.fine.critical
        marked = replace(item, tiles=replace(item.tiles, fine=replace(item.tiles.fine, z=z)))
        images, = blocks(scene_chapter(replace(study, strategies=(marked,)), "x", "x"), Pictures)
        shown = images.rows[0].pictures[-1]
        assert (shown.title, shown.file.name) == ("Smaller tiles", "x-deviates-mixture.png")
        pixels = np.asarray(Image.open(io.BytesIO(shown.file.content)).convert("RGB"), dtype=float)
        assert pixels.shape == (32, 32, 3)
        red = pixels[..., 0] - pixels[..., 2]
        assert (red[:2, -2:] > 50).all() and abs(np.delete(red, slice(30, 32), axis=1)).max() < 5
