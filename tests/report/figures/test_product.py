"""Figures of studies over parameters: every line in every panel, told apart without colour, whatever is missing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest

from harness.report.figures import product as figures
from harness.report.figures.style import RC, styles
from harness.studies.product import StudyProduct
from tests.support.studies import SPP, line, product, study


@pytest.fixture(autouse=True)
def settings() -> object:
    with matplotlib.rc_context({**RC}):  # type: ignore[arg-type]
        yield


def test_every_figure_has_a_panel_a_study_and_a_line_an_estimator() -> None:
    held = product()
    for draw in (figures.error_by_samples, figures.error_by_time, figures.ssim_by_samples,
                 figures.mean_error_by_samples):
        panels = [axes for axes in draw(held).get_axes() if axes.get_visible()]
        assert len(panels) == 6
        assert [axes.get_title(loc="left") for axes in panels[:2]] == ["ball alpha=1 lens=none",
                                                                       "ball alpha=1 lens=thin"]
        for axes in panels:
            assert sum(1 for drawn in axes.get_lines() if drawn.get_marker() not in ("", "None", None)) == 2


def test_against_time_points_stand_at_seconds() -> None:
    axes, = figures.error_by_time(StudyProduct((), (study(line("uniform", seconds=0.25)),))).get_axes()
    drawn = next(each for each in axes.get_lines() if each.get_marker() == "o")
    np.testing.assert_allclose(drawn.get_xdata(), 0.25 * SPP)


def test_devices_are_named_where_there_are_several() -> None:
    held = StudyProduct((), (study(line("uniform"), line("myrt", device="cpu: another")),))
    labels = [text.get_text() for text in figures.error_by_time(held).legends[0].get_texts()]
    assert labels == ["uniform [1]", "myrt [2]"]
    assert figures.error_by_time(held).get_suptitle() == (
        "RMSE relative to the mean, against time of [1] llvmpipe (LLVM 15.0.6, 256 bits), [2] cpu: another")
    assert figures.error_by_time(held).get_axes()[0].get_xlabel() == "seconds on its device"


def test_against_a_parameter_a_point_stands_at_each_value_for_each_of_the_others() -> None:
    figure = figures.error_by_parameter(product(), "alpha")
    panels = figure.get_axes()
    assert [axes.get_title(loc="left") for axes in panels] == ["ball lens=none", "ball lens=thin"]
    assert {axes.get_xscale() for axes in panels} == {"log"}
    uniform = next(each for each in panels[0].get_lines() if each.get_marker() == "o")
    np.testing.assert_allclose(uniform.get_xdata(), [1, 10, 100])
    np.testing.assert_allclose(uniform.get_ydata(), 2 * np.array([1, 10, 100]) ** 0.25 / 8, rtol=0.05)
    with pytest.raises(ValueError, match=r"'lens' does not have several values that are numbers; .*: alpha"):
        figures.error_by_parameter(product(), "lens")


def test_efficiency_has_its_interval_and_a_row_an_estimator() -> None:
    axes = figures.efficiency(product()).get_axes()[0]
    assert [text.get_text() for text in axes.get_yticklabels()] == ["uniform", "myrt"]
    assert len(axes.containers) == 2


def test_what_cannot_be_drawn_leaves_the_figure_whole() -> None:
    """Images without a clock, one point, no error at all."""
    nothing = line("kept", spp=SPP[-1:], seconds=float("nan"))
    exact = line("exact", error=0.0)
    held = StudyProduct((), (study(nothing), study(exact), study(replace(exact, slope=None), nothing)))
    for name, draw in figures.figures(held).items():
        figure = draw()
        figure.canvas.draw()  # type: ignore[no-untyped-call]
        assert figure.get_axes(), f"{name} has no axes"


def test_all_are_written_as_svg_whose_letters_need_no_font(tmp_path: Path) -> None:
    figures.write_figures(StudyProduct(product().axes, product().studies[::2]), tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "efficiency-by-alpha.svg", "efficiency.svg", "error-by-alpha.svg", "error-by-samples.svg", "error-by-time.svg",
        "mean-error.svg", "ssim.svg"]
    assert b"<text" not in (tmp_path / "ssim.svg").read_bytes()


def test_strangers_have_styles_that_no_other_has() -> None:
    found = styles(["mixture", "mixture sobol", "a", "b", "c", "d", "e", "f"])
    assert found["mixture"] == found["mixture sobol"]
    assert len({style.marker for name, style in found.items() if name != "mixture sobol"}) == 7
