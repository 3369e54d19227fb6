"""What the page holds for its viewers is what was measured, to half precision, in few bytes."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
from typing import Any

import matplotlib
import numpy as np
import pytest

from harness.metrics import flip_map, signed_relative_difference
from harness.report import Inputs
from harness.report.blocks import Pictures
from harness.report.chapters import scenes
from harness.report.document import compose
from harness.report.figures.pictures import DIFFERENCE_MAP
from harness.report.pages.html import html_page
from harness.report.pixels import LARGEST, packed, plane, unpacked
from harness.results import StudyResult

HALF = 2.0**-11  # relative, of a number of 2^-14 and more; below it absolute, in steps of 2^-24


@pytest.fixture(scope="module")
def page(study: StudyResult) -> str:
    return html_page(compose(Inputs([study], "quick")))


@pytest.fixture(scope="module")
def held(page: str) -> Any:
    (text,) = re.findall(r'<script type="application/json" class="pixels">(.*?)</script>', page)
    return json.loads(text)


def array(stored: dict[str, Any]) -> np.ndarray:
    return unpacked(base64.b64decode(stored["data"]), (stored["height"], stored["width"], stored["channels"]))


def test_any_numbers_come_back(page: str) -> None:
    values = np.array([[[0.0, -1.0, 1e-7], [65504.0, 1e9, -1e9]], [[np.nan, 1 / 3, 2.0**-24], [3.0, 4.0, 5.0]]])
    expected = np.clip(values, -LARGEST, LARGEST)
    np.testing.assert_allclose(plane(values).array(), expected, rtol=HALF, atol=2.0**-25)
    one = np.arange(6.0).reshape(2, 3)
    np.testing.assert_array_equal(plane(one).array()[..., 0], one)


def test_the_page_holds_every_strategy_as_it_was_measured(held: Any, study: StudyResult) -> None:
    reference = study.reference.mean
    np.testing.assert_allclose(array(held["reference"]), reference, rtol=HALF)
    strategies = {each.strategy: each for each in study.strategies}
    assert {test["name"] for test in held["tests"]} == strategies.keys()
    assert held["tests"][0]["name"] == scenes.best_strategy(study).strategy
    for test in held["tests"]:
        found = strategies[test["name"]]
        mean = found.estimate.mean
        np.testing.assert_allclose(array(test["image"]), mean, rtol=HALF, atol=2.0**-25)
        np.testing.assert_allclose(array(test["difference"])[..., 0], signed_relative_difference(mean, reference),
                                   rtol=HALF, atol=2.0**-25)
        np.testing.assert_allclose(array(test["flip"])[..., 0], flip_map(mean, reference, study.exposure), rtol=HALF,
                                   atol=2.0**-25)
        np.testing.assert_allclose(array(test["deviates"])[..., 0], found.tiles.fine.z, rtol=HALF, atol=2.0**-25)
        assert test["tile"] == found.tiles.fine.tile
    assert held["exposure"] == study.exposure


def test_pixels_cost_few_bytes(page: str, study: StudyResult) -> None:
    """At most what halves take in base64, of eight numbers a pixel and test and three of the reference; noise, as here,
    leaves little to compress."""
    pixels = study.reference.mean[..., 0].size
    bare = len(re.sub(r'<script type="application/json" class="pixels">.*?</script>', "", page))
    assert len(page) - bare < 4 / 3 * 2 * pixels * (3 + 5.1 * len(study.strategies))


def test_a_longer_report_holds_the_best_strategy_alone(exact: StudyResult) -> None:
    studies = [dataclasses.replace(exact, scene=f"scene {index}") for index in range(4)]
    for several, expected in ((studies[:3], 2), (studies, 1)):
        found = [block.pixels for chapter in compose(Inputs(several, "quick")).chapters for block in chapter.blocks
                 if isinstance(block, Pictures) and block.pixels]
        assert [len(pixels.tests) for pixels in found] == [expected] * len(several)


def test_a_large_image_is_as_small_as_its_picture(exact: StudyResult, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scenes.pictures, "MAX_PIXELS", 16)
    (pixels,) = (block.pixels for block in scenes.scene_chapter(exact, "x", "x").blocks
                 if isinstance(block, Pictures) and block.pixels)
    tile = exact.strategies[0].tiles.fine.tile
    assert (pixels.reference.width, pixels.tests[0].image.width, pixels.tests[0].tile) == (16, 16, tile / 2)


def test_a_name_cannot_leave_the_element_it_stands_in(study: StudyResult) -> None:
    first = dataclasses.replace(study.strategies[0], strategy="</script><b>")
    page = html_page(compose(Inputs([dataclasses.replace(study, strategies=(first,))], "quick")))
    assert "</script><b>" not in page
    (text,) = re.findall(r'class="pixels">(.*?)</script>', page)
    assert json.loads(text)["tests"][0]["name"] == "</script><b>"


def test_the_maps_have_the_colours_of_the_pictures(page: str) -> None:
    (text,) = re.findall(r'<script type="application/json" id="palettes">(.*?)</script>', page)
    colours = np.frombuffer(base64.b64decode(json.loads(text)["signed"]), np.uint8).reshape(-1, 3)
    expected = matplotlib.colormaps[DIFFERENCE_MAP](np.linspace(0, 1, 255), bytes=True)
    np.testing.assert_array_equal(colours, expected[:, :3])


def test_another_shape_is_refused() -> None:
    with pytest.raises(ValueError):
        unpacked(packed(np.zeros((2, 3))), (2, 2, 1))
