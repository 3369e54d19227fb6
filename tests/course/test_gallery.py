"""Long pictures: visible from the first samples on, continued after an interruption, never mixed with another."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from harness.api import render
from harness.course.gallery import Picture, render_picture
from harness.course.kept import RECORDS_FILE, keep, kept_folder, load_kept
from harness.errors import StoreError
from harness.samples.exr import read_estimate
from harness.samples.store import LEAD_IN, Store
from harness.scene import Scene, load_scene
from harness.work.executors import executor

SPHERES = Path(__file__).parents[2] / "mitsuba_scenes" / "spheres.xml"
SPP = 261  # a long run, whose last batch is cut


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A small image."""
    return load_scene(SPHERES, width=24, height=16)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """Where samples are kept, apart from the pictures made of them."""
    return Store(tmp_path / "store")


@contextmanager
def interrupted_after(samples: float) -> Iterator[Callable[[float], None]]:
    """A progress display that raises KeyboardInterrupt once `samples` are done."""
    left = samples

    def advance(n: float) -> None:
        nonlocal left
        left -= n
        if left <= 0:
            raise KeyboardInterrupt

    yield advance


def pixels(picture: Picture) -> np.ndarray:
    return read_estimate(picture.exr)[0].mean


def test_a_picture_is_the_render_of_its_samples(scene: Scene, store: Store, tmp_path: Path) -> None:
    """As any run of them."""
    picture = render_picture(scene, SPP, tmp_path, store=store)
    assert (picture.samples, picture.resumed, picture.rejected) == (SPP, 0, 0)
    assert picture.seconds > 0 and picture.device
    np.testing.assert_allclose(pixels(picture), render(scene, "mixture", SPP).mean, rtol=2e-6)


def test_it_can_be_looked_at_after_the_first_sample(scene: Scene, store: Store, tmp_path: Path) -> None:
    """The first state is saved at once, as a PNG of the picture's size."""
    states: list[Picture] = []
    render_picture(scene, 8, tmp_path, store=store, saved=states.append)
    assert states[0].samples == 1
    assert Image.open(states[0].png).size == (scene.width, scene.height)


def test_an_interrupted_picture_goes_on_where_it_was(scene: Scene, store: Store, tmp_path: Path) -> None:
    """No batch is rendered twice but the first, which no long run keeps, and the result is bit for bit that of an
    uninterrupted render."""
    with pytest.raises(KeyboardInterrupt):
        render_picture(scene, SPP, tmp_path / "a", store=store, progress=lambda total, words: interrupted_after(200))
    assert read_estimate(tmp_path / "a" / "spheres.exr")[0].samples == 128, "what there is can be looked at"
    resumed = render_picture(scene, SPP, tmp_path / "a", store=store)
    assert (resumed.samples, resumed.resumed) == (SPP, 128 - LEAD_IN)
    whole = render_picture(scene, SPP, tmp_path / "b", store=Store(tmp_path / "another"))
    np.testing.assert_array_equal(pixels(resumed), pixels(whole))


def test_whoever_drew_its_samples_it_is_the_same(scene: Scene, store: Store, tmp_path: Path) -> None:
    """In processes, as on a cluster, and partly here before."""
    here = render_picture(scene, SPP, tmp_path / "here", store=Store(tmp_path / "another"))
    render_picture(scene, 32, tmp_path / "there", store=store)
    told: list[float] = []
    with executor("processes", 2) as workers:
        there = render_picture(scene, SPP, tmp_path / "there", store=store, executor=workers,
                               progress=lambda total, words: nullcontext(told.append))
    np.testing.assert_array_equal(pixels(there), pixels(here))
    assert sum(told) == SPP
    assert (there.samples, there.resumed) == (SPP, 32)


def test_a_longer_one_goes_on_from_a_shorter_one(scene: Scene, store: Store, tmp_path: Path) -> None:
    """And the shorter state stays to be seen until there is more."""
    short = render_picture(scene, 32, tmp_path, store=store)
    before = short.exr.read_bytes()
    with pytest.raises(KeyboardInterrupt):
        render_picture(scene, SPP, tmp_path, store=store, progress=lambda total, words: interrupted_after(64))
    assert short.exr.read_bytes() == before
    assert render_picture(scene, SPP, tmp_path, store=store).resumed == 32


def test_a_finished_picture_stays_as_it_is(scene: Scene, store: Store, tmp_path: Path) -> None:
    """Asked again for as many samples or fewer, nothing is rendered or written; a lost PNG is made again."""
    first = render_picture(scene, 4, tmp_path, store=store)
    before = first.exr.stat().st_mtime_ns
    again = render_picture(scene, 3, tmp_path, store=Store(tmp_path / "another"))
    assert (again.samples, again.resumed, again.device) == (4, 4, first.device)
    assert again.seconds == pytest.approx(first.seconds)
    assert first.exr.stat().st_mtime_ns == before
    first.png.unlink()
    assert render_picture(scene, 4, tmp_path, store=store).png.exists()


def _shallower(folder: Path) -> Scene:
    """A file of the same name, with shorter paths."""
    folder.mkdir()
    text, deep = SPHERES.read_text(encoding="utf-8"), '<integer name="max_depth" value="6"/>'
    assert deep in text
    (folder / SPHERES.name).write_text(text.replace(deep, deep.replace("6", "2")), encoding="utf-8")
    return load_scene(folder / SPHERES.name, width=24, height=16)


def test_another_picture_is_never_replaced(scene: Scene, store: Store, tmp_path: Path) -> None:
    """Another size or depth under the same name is refused, as is a file that is no picture of ours."""
    render_picture(scene, 2, tmp_path, store=store)
    for other in (load_scene(SPHERES, width=24, height=17), _shallower(tmp_path / "other")):
        with pytest.raises(StoreError, match="another picture"):
            render_picture(other, 2, tmp_path, store=store)
    (tmp_path / "spheres.exr").write_bytes(b"not an image")
    with pytest.raises(StoreError, match="not an OpenEXR file"):
        render_picture(scene, 2, tmp_path, store=store)


class TestKept:
    """As JPEGs, with what they took."""

    def test_is_the_picture_that_was_rendered_and_what_it_took(self, scene: Scene, store: Store,
                                                               tmp_path: Path) -> None:
        picture = render_picture(scene, 16, tmp_path, store=store)
        record = keep(picture, scene, tmp_path / "kept")
        assert (record.width, record.height, record.spp, record.rejected) == (24, 16, 16, 0)
        assert (record.seconds, record.device) == (picture.seconds, picture.device)
        shown = np.asarray(Image.open(tmp_path / "kept" / "spheres.jpg"), dtype=float)
        png = np.asarray(Image.open(picture.png), dtype=float)
        assert shown.shape == png.shape and np.abs(shown - png).mean() < 8
        assert load_kept(tmp_path / "kept") == (record,)

    def test_again_it_takes_the_place_of_the_former(self, scene: Scene, store: Store, tmp_path: Path) -> None:
        for samples in (4, 8):
            keep(render_picture(scene, samples, tmp_path, store=store), scene, tmp_path / "kept")
        assert [record.spp for record in load_kept(tmp_path / "kept")] == [8]

    def test_a_damaged_list_or_a_missing_picture_is_told_in_one_line(self, scene: Scene, store: Store,
                                                                     tmp_path: Path) -> None:
        keep(render_picture(scene, 4, tmp_path, store=store), scene, tmp_path)
        (tmp_path / "spheres.jpg").unlink()
        with pytest.raises(StoreError, match=r"the picture is missing that pictures\.json names; keep it again"):
            load_kept(tmp_path)
        (tmp_path / RECORDS_FILE).write_text("[]", encoding="utf-8")
        with pytest.raises(StoreError, match="not a list of pictures"):
            load_kept(tmp_path)

    def test_those_that_come_with_the_harness_are_there(self) -> None:
        for record in load_kept(kept_folder()):
            assert Image.open(kept_folder() / record.file).size == (record.width, record.height)
