"""Whole exhibits, small: images against Mitsuba, words with their numbers, and files that come back as they were."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from harness.course import collection, load_exhibits, measure_exhibits, pictures, save_exhibits
from harness.course.texts import TEXTS, exhibit
from harness.errors import StoreError
from harness.results import Exhibit, ExhibitImage, Finding, Plot, Series
from harness.samples.store import Store

EXHIBIT = exhibit(
    "convergence", [Finding("equal error", "samples", "more", 0.011, "number", True, False)],
    [ExhibitImage("a", np.arange(6, dtype=np.float32).reshape(2, 1, 3)),
     ExhibitImage("b", np.ones((2, 2), dtype=np.float32), "deviations")],
    [Plot("t", "x", "xy", (Series("ours", True, np.ones(3, dtype=np.float32), np.arange(3, dtype=np.float32)),))],
    message="no", samples=90.0, low=80.0, high=100.0, time=70.0)


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Images of 64 × 48 pixels with an eighth of the samples."""
    for name, value in (("SPP", 64), ("REFERENCE_SPP", 128), ("WIDTH", 64), ("HEIGHT", 48)):
        monkeypatch.setattr(pictures, name, value)
    pictures.scene_of.cache_clear()
    yield
    pictures.scene_of.cache_clear()


@pytest.mark.parametrize(("make", "size"), [
    (pictures.lobe_pdf, 0.09), (pictures.tangent, -0.095),
])
def test_images_go_wrong_by_as_much_as_the_report_says(
    small: None, make: Callable[[Store | None], Exhibit], size: float,
) -> None:
    """The verdict against Mitsuba fails the handout's image and not ours; the error is that of the full size."""
    found = make(None).findings[-1]
    assert found.check == "mean error" and found.caught
    assert found.handout == pytest.approx(size, abs=0.015)
    assert found.ours == pytest.approx(0, abs=0.004)


def test_what_is_below_the_surface_shows_in_images(small: None) -> None:
    errors = [found for found in pictures.below_surface(None).findings if found.check == "mean error"]
    values = [found.handout for found in errors]
    assert values == pytest.approx([-0.0044, 0.0195, 0.0395, 0], abs=0.004)
    assert [found.caught for found in errors[1:]] == [True, True, False]


def test_every_text_belongs_to_an_exhibit_and_has_a_place_for_its_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """All are measured, in the order of the collection; progress is told of each."""
    made = [lambda store, id=id: dataclasses.replace(EXHIBIT, id=id) for id in TEXTS]
    assert len(collection.EXHIBITS) == len(TEXTS)
    monkeypatch.setattr(collection, "EXHIBITS", made)
    assert [found.id for found in measure_exhibits()] == list(TEXTS)


def test_numbers_stand_in_the_words() -> None:
    assert "takes 90 times the samples" in EXHIBIT.effect and "80 to 100" in EXHIBIT.effect
    assert EXHIBIT.size == "without it 90 times the samples"
    with pytest.raises(KeyError):
        exhibit("convergence", [])


def test_exhibits_come_back_from_disk_as_they_were(tmp_path: Path) -> None:
    save_exhibits([EXHIBIT, EXHIBIT], tmp_path)
    for found in load_exhibits(tmp_path):
        for field in dataclasses.fields(Exhibit):
            if field.name not in ("images", "plots"):
                assert getattr(found, field.name) == getattr(EXHIBIT, field.name)
        for image, original in zip(found.images, EXHIBIT.images, strict=True):
            assert (image.title, image.unit) == (original.title, original.unit)
            np.testing.assert_array_equal(image.image, original.image)
        (plot,), (original_plot,) = found.plots, EXHIBIT.plots
        assert (plot.title, plot.x_label, plot.log) == ("t", "x", "xy")
        np.testing.assert_array_equal(plot.series[0].y, original_plot.series[0].y)


@pytest.mark.parametrize("damage", ["missing", "truncated", "no arrays", "something else"])
def test_damaged_files_are_refused_in_one_line(tmp_path: Path, damage: str) -> None:
    save_exhibits([EXHIBIT], tmp_path)
    words = tmp_path / "exhibits.json"
    if damage == "missing":
        words.unlink()
    elif damage == "truncated":
        words.write_text(words.read_text(encoding="utf-8")[:-20], encoding="utf-8")
    elif damage == "no arrays":
        (tmp_path / "exhibits.npz").write_bytes(b"PK")
    else:
        words.write_text('[{"id": 1}]', encoding="utf-8")
    told = r"exhibits\.(json: not exhibits of the handout|npz: missing or damaged) \(.*\); remove it and measure again"
    with pytest.raises(StoreError, match=told) as caught:
        load_exhibits(tmp_path)
    assert "\n" not in str(caught.value)
