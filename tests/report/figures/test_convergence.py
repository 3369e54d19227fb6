"""Curves are vector figures with text as text, the same on every run, with nothing clipped or overlapping."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from harness.report.figures import convergence
from harness.report.figures.convergence import curves, curves_svg
from harness.report.figures.style import RC, strategy_style
from harness.report.figures.svg import blank
from harness.results import StudyResult
from harness.stats.convergence import band
from tests.support.report import with_curves, with_measured


def words(svg: str) -> str:
    """All text elements of an SVG, joined."""
    return " | ".join(re.findall(r"<text[^>]*>([^<]*)</text>", svg))


@pytest.fixture(scope="module")
def svg(study: StudyResult) -> str:
    return curves_svg(study).decode()


def test_text_stays_text_and_no_pixels_are_embedded(svg: str) -> None:
    found = words(svg)
    for expected in ("RMSE (radiance)", "Mean error of luminance", "SSIM", "samples per pixel", "+0.2 %", "slope −1/2"):
        assert expected in found
    assert "<image" not in svg


def test_every_marker_says_its_value(study: StudyResult, svg: str) -> None:
    """As the axis writes it; the verdict's point with the samples that it stands on, not its place beside others."""
    told = re.findall(r"<use [^>]*><title>([^<]*)</title></use>", svg)
    points = sum(3 * each.spp.size + 1 for each in study.strategies)
    assert len(told) == points
    for strategy in study.strategies:
        rmse = band(strategy.curves["rmse"], strategy.verdict.confidence, geometric=True)[0]
        for spp, value in zip(strategy.spp, rmse, strict=True):
            assert f"{strategy.strategy}; samples per pixel: {spp}; RMSE (radiance): {float(f'{value:.4g}'):g}" in told
        error = f"{100 * strategy.verdict.luminance[0]:+.4g} %".replace("-", "−")
        assert (f"{strategy.strategy}, all replicas; samples per pixel: {strategy.estimate.samples:,}; "
                f"Mean error of luminance: {error}") in told


def test_the_legend_gives_every_strategy_its_slope_and_interval(study: StudyResult, svg: str) -> None:
    for strategy in study.strategies:
        slope = strategy.slope
        assert slope is not None
        remark = "" if strategy.suits else r" \(not suited\)"
        value = f"{slope.slope:.3f} ± {(slope.high - slope.low) / 2:.3f}".replace("-", "−")
        assert re.search(rf"{strategy.strategy}{remark}: slope {value}", words(svg))


def test_every_strategy_has_its_own_colour_and_marker(study: StudyResult, svg: str) -> None:
    styles = [strategy_style(strategy.strategy) for strategy in study.strategies]
    assert len({style.colour for style in styles}) == len({style.marker for style in styles}) == len(styles)
    assert all(style.colour in svg for style in styles)
    assert strategy_style("a strategy to come") == strategy_style("a strategy to come")


def test_only_strategies_that_do_not_suit_are_dashed(study: StudyResult, svg: str) -> None:
    dashed = set(re.findall(r"stroke-dasharray[^\"]*stroke: (#\w+)", svg))
    assert dashed == {strategy_style("phong").colour}


def test_the_same_result_gives_the_same_file_and_a_small_one(
    study: StudyResult, svg: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
) -> None:
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path))  # drawn again, not read back
    assert curves_svg(study).decode() == svg
    assert len(svg) < 150_000


def test_a_figure_is_drawn_once_and_another_one_for_another_result(
    study: StudyResult, monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
) -> None:
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path))
    drawn: list[StudyResult] = []
    monkeypatch.setattr(convergence, "curves", lambda result: drawn.append(result) or blank(2, 2))
    other = replace(study, strategies=study.strategies[1:])
    for result in (study, study, other, replace(study)):
        curves_svg(result)
    assert drawn == [study, other]


def unreadable(study: StudyResult, synthetic: ModuleType) -> list[StudyResult]:
    """Results that strain a figure: one strategy, huge and tiny errors, long runs, nothing finite, two prefixes."""
    first = study.strategies[0]
    none = with_curves(first, **{name: curve * np.nan for name, curve in first.curves.items()})
    return [study, synthetic.exact_study(), replace(study, strategies=study.strategies[:1]),
            replace(study, strategies=(with_curves(first, mean_error=first.curves["mean_error"] * 1e9),)),
            replace(study, strategies=(with_measured(first, spp=8**np.arange(len(first.spp))),)),
            replace(study, strategies=(with_curves(first, rmse=first.curves["rmse"] * 1e-5),)),
            replace(study, strategies=(none,)), synthetic.study_result("short", spp=2, replicas=1)]


def test_nothing_is_clipped_or_overlaps(study: StudyResult, synthetic: ModuleType) -> None:
    for result in unreadable(study, synthetic):
        with matplotlib.rc_context(RC):  # type: ignore[arg-type]
            figure = curves(result)
            figure.canvas.draw()
            boxes = text_boxes(figure)
        page = figure.bbox
        for text, box in boxes:
            assert page.x0 <= box.x0 and box.x1 <= page.x1 and page.y0 <= box.y0 and box.y1 <= page.y1, text
        for (text, box), (other, second) in itertools.combinations(boxes, 2):
            assert not Bbox.intersection(shrunk(box), shrunk(second)), f"{result.scene}: {text!r} covers {other!r}"


def text_boxes(figure: Figure) -> list[tuple[str, Bbox]]:
    """Every text that is drawn, with its place on the figure in pixels."""
    texts = [text for legend in figure.legends for text in legend.get_texts()]
    for axes in figure.axes:
        (left, right), (low, high) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
        texts += [axes.title, axes._left_title, axes.xaxis.label, *axes.texts]
        texts += [tick.label1 for tick in axes.xaxis.get_major_ticks() if left <= tick.get_loc() <= right]
        texts += [tick.label1 for tick in axes.yaxis.get_major_ticks() if low <= tick.get_loc() <= high]
    return [(text.get_text(), text.get_window_extent()) for text in texts if text.get_text()]


def shrunk(box: Bbox) -> Bbox:
    """A box without the line spacing above and below its letters."""
    return Bbox.from_extents(box.x0, box.y0 + 0.15 * box.height, box.x1, box.y1 - 0.15 * box.height)
