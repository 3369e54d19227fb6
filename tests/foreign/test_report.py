"""The report's page in Chromium: its viewers, charts and colours, with scripts and without. Run by `make hosts`."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from harness.report import Inputs, build_report
from harness.results import StudyResult
from harness.samples.images import display_pixels
from tests.foreign.browser import Page, browser
from tests.support.report import study_result

STAGE = ".frame canvas"
SIZE = 32  # pixels of a side of the study's images
# Two frames: what was asked for is drawn in the first.
DRAWN = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"


@pytest.fixture(scope="module")
def study() -> StudyResult:
    return study_result("spheres", size=SIZE)


@pytest.fixture(scope="module")
def file(study: StudyResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    build_report(Inputs([study], "quick"), folder)
    return folder / "report.html"


@pytest.fixture(scope="module")
def chrome(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with browser(tmp_path_factory.mktemp("profile")) as page:
        yield page


@pytest.fixture
def page(chrome: Page, file: Path) -> Iterator[Page]:
    """The report, its first viewer in view; a script's error, a complaint or a request fails the test at its end."""
    chrome.errors.clear()
    chrome.open(file)
    show(chrome)
    yield chrome
    assert chrome.errors == []


def show(page: Page) -> None:
    page.run("document.querySelector('script.pixels').closest('figure').scrollIntoView()")
    page.wait(f"document.querySelector({json.dumps(STAGE)})?.width > 300")
    page.run(DRAWN)


def stage(page: Page) -> np.ndarray:
    """What is on the large canvas at the middle of each pixel of the image, (SIZE, SIZE, 3)."""
    page.run(DRAWN)
    script = f"""(() => {{
        const canvas = document.querySelector({json.dumps(STAGE)}), found = [];
        const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
        for (let y = 0; y < {SIZE}; y++)
            for (let x = 0; x < {SIZE}; x++) {{
                const column = Math.floor((x + 0.5) * canvas.width / {SIZE});
                const at = 4 * (Math.floor((y + 0.5) * canvas.height / {SIZE}) * canvas.width + column);
                found.push(data[at], data[at + 1], data[at + 2]);
            }}
        return found;
    }})()"""
    return np.array(page.run(script), dtype=float).reshape(SIZE, SIZE, 3)


def slide(page: Page, selector: str, value: float) -> None:
    """What a hand does to a slider."""
    page.run(f"""(input => {{ input.value = {value}; input.dispatchEvent(new Event("input")); }})
             (document.querySelector({json.dumps(selector)}))""")


def best(study: StudyResult) -> np.ndarray:
    return next(each.estimate.mean for each in study.strategies if each.strategy == "mixture")


def test_the_slider_divides_test_from_reference(page: Page, study: StudyResult) -> None:
    test, reference = (display_pixels(image, study.exposure) for image in (best(study), study.reference.mean))
    seen = stage(page)
    np.testing.assert_allclose(seen[:, :SIZE // 2 - 1], test[:, :SIZE // 2 - 1], atol=1)
    np.testing.assert_allclose(seen[:, SIZE // 2 + 1:], reference[:, SIZE // 2 + 1:], atol=1)
    slide(page, ".divider", 0.25)
    np.testing.assert_allclose(stage(page)[:, SIZE // 4 + 1:], reference[:, SIZE // 4 + 1:], atol=1)
    left, top, width, height = page.place(STAGE)
    page.drag(left + width / 4, top + height / 2, left + width * 0.75, top + height / 2)
    page.pointer("Moved", 2, 2)
    np.testing.assert_allclose(stage(page)[:, :SIZE * 3 // 4 - 1], test[:, :SIZE * 3 // 4 - 1], atol=1)
    assert float(page.run("document.querySelector('.divider').value")) == pytest.approx(0.75, abs=0.01)


def test_a_click_and_a_key_flip(page: Page, study: StudyResult) -> None:
    test, reference = (display_pixels(image, study.exposure) for image in (best(study), study.reference.mean))
    left, top, width, height = page.place(STAGE)
    for expected in (reference, test):
        for kind in ("Pressed", "Released"):
            page.pointer(kind, left + width / 2, top + height / 2)
        page.pointer("Moved", 2, 2)
        np.testing.assert_allclose(stage(page), expected, atol=1)
    page.key("f")
    np.testing.assert_allclose(stage(page), reference, atol=1)
    left, top, width, height = page.place(".panels button:nth-child(3) canvas")
    for kind in ("Pressed", "Released"):
        page.pointer(kind, left + width / 2, top + height / 2)
    page.run(DRAWN)
    label = page.run("document.querySelector('.frame .front').textContent")
    assert label == "Relative difference"
    assert np.abs(stage(page) - test).mean() > 20
    page.key("2")
    page.run(DRAWN)
    assert page.run("document.querySelector('.frame .front').textContent") == "Mitsuba"


def test_exposure_and_gamma_change_the_pixels_as_they_should(page: Page, study: StudyResult) -> None:
    slide(page, ".divider", 1)
    before = stage(page)
    slide(page, "input[name=Exposure]", study.exposure - 2)
    darker = stage(page)
    np.testing.assert_allclose(darker, display_pixels(best(study), study.exposure - 2), atol=1)
    assert darker.mean() < before.mean() - 20
    slide(page, "input[name=Gamma]", 2)
    expected = 255 * (display_pixels(best(study), study.exposure - 2) / 255.0) ** 0.5
    np.testing.assert_allclose(stage(page), expected, atol=6)  # of eight bits in the dark


def test_zoom_is_shared_and_numbers_are_told(page: Page, study: StudyResult) -> None:
    left, top, width, height = page.place(STAGE)
    x, y = SIZE // 4, SIZE // 3
    page.pointer("Moved", left + width * (x + 0.5) / SIZE, top + height * (y + 0.5) / SIZE)
    rows = page.run("[...document.querySelectorAll('.readout tr')].map(row => "
                    "[...row.children].map(cell => cell.textContent))")
    assert rows[0][0] == f"x {x}, y {y}"
    for row, image in ((rows[1], best(study)), (rows[2], study.reference.mean)):
        assert [float(cell) for cell in row[1:4]] == pytest.approx(image[y, x], rel=1e-3)
    relative = (best(study) - study.reference.mean)[y, x] @ [0.2126, 0.7152, 0.0722] / (
        study.reference.mean[y, x] @ [0.2126, 0.7152, 0.0722])
    assert float(rows[3][1].replace("−", "-").rstrip(" %")) == pytest.approx(100 * relative, rel=1e-2)

    tile = next(each.tiles.fine for each in study.strategies if each.strategy == "mixture")
    assert float(rows[4][1].replace("−", "-")) == pytest.approx(tile.z[y // tile.tile, x // tile.tile], rel=1e-2)

    small = "document.querySelectorAll('.panels canvas')[1].toDataURL()"
    page.pointer("Moved", 2, 2)
    page.run(DRAWN)
    whole = page.run(small)
    page.run(f"document.querySelector({json.dumps(STAGE)}).focus()")
    page.pointer("Wheel", left + width / 4, top + height / 4, deltaX=0, deltaY=-480)
    page.run(DRAWN)
    assert page.run(small) != whole, "the reference's small picture follows"
    page.key("0")
    page.pointer("Moved", 2, 2)
    page.run(DRAWN)
    assert page.run(small) == whole


def test_another_strategy_can_be_chosen(page: Page, study: StudyResult) -> None:
    slide(page, ".divider", 1)
    page.run("(choice => { choice.value = 'uniform'; choice.dispatchEvent(new Event('change')); })"
             "(document.querySelector('select[name=test]'))")
    page.wait("document.querySelector('.frame .front').textContent === 'GLSL, uniform'")
    uniform = next(each.estimate.mean for each in study.strategies if each.strategy == "uniform")
    np.testing.assert_allclose(stage(page), display_pixels(uniform, study.exposure), atol=1)


def test_a_chart_says_the_value_under_the_pointer(page: Page, study: StudyResult) -> None:
    page.run("document.querySelector('.curves svg').scrollIntoView()")
    x, y = page.run("""(marker => {
        const place = new DOMPoint(marker.x.baseVal.value, marker.y.baseVal.value);
        const {x, y} = place.matrixTransform(marker.parentElement.getScreenCTM());
        return [x, y];
    })(document.querySelector(".curves svg [id$=values-0] use"))""")
    page.pointer("Moved", x + 3, y - 2)
    told = page.run("document.querySelector('.tip').innerText").split("\n")
    assert told[0] == "uniform" and told[1] == "samples per pixel: 1"
    assert not page.run("document.querySelector('.tip').hidden")
    ring = page.run("(ring => [ring.left + ring.width / 2, ring.top + ring.height / 2])"
                    "(document.querySelector('.pointed').getBoundingClientRect())")
    assert ring == pytest.approx([x, y], abs=1)
    page.pointer("Moved", 2, 2)
    assert page.run("document.querySelector('.tip').hidden")


@pytest.mark.parametrize("dark", [False, True])
def test_the_page_is_as_dark_as_the_system_until_the_reader_chooses(chrome: Page, file: Path, dark: bool) -> None:
    chrome.open(file, dark=dark)
    chrome.run("localStorage.clear()")
    chrome.open(file, dark=dark)
    lightness = "getComputedStyle(document.querySelector('main')).backgroundColor.match(/\\d+/)[0] / 255"
    assert (chrome.run(lightness) < 0.2) == dark
    chrome.run("document.querySelector('button.theme').click()")
    assert (chrome.run(lightness) < 0.2) != dark
    chrome.open(file, dark=dark)
    assert (chrome.run(lightness) < 0.2) != dark, "it remembers"
    chrome.print()
    assert chrome.run(lightness) == 1, "paper is white"
    assert chrome.run("getComputedStyle(document.querySelector('.curves svg')).filter") == "none"
    chrome.run("localStorage.clear()")


@pytest.mark.parametrize("width", [1280, 420])
def test_nothing_is_wider_than_the_window(chrome: Page, file: Path, width: int) -> None:
    chrome.open(file, width=width)
    show(chrome)
    assert chrome.run("document.documentElement.scrollWidth") <= width


def test_without_scripts_the_pictures_are_there(chrome: Page, file: Path) -> None:
    chrome.open(file, scripts=False)
    width, height = chrome.place(".pictures img")[2:]
    assert min(width, height) > 100
    assert chrome.run("document.querySelector('.viewer, button')") is None


def test_a_broken_image_shows_where(chrome: Page, study: StudyResult, tmp_path: Path) -> None:
    """NaN is magenta in the image and grey in the map, as in the pictures; the rest is as it is."""
    first = next(each for each in study.strategies if each.strategy == "mixture")
    mean = first.estimate.mean.copy()
    mean[3, 5] = np.nan
    broken = dataclasses.replace(first, estimate=dataclasses.replace(first.estimate, mean=mean))
    build_report(Inputs([dataclasses.replace(study, strategies=(broken,))], "quick"), tmp_path)
    chrome.errors.clear()
    chrome.open(tmp_path / "report.html")
    show(chrome)
    slide(chrome, ".divider", 1)
    assert stage(chrome)[3, 5].tolist() == [255, 0, 255]
    chrome.run("document.querySelectorAll('.panels button')[2].click()")
    assert stage(chrome)[3, 5].tolist() == [160, 160, 160]
    assert chrome.errors == []
