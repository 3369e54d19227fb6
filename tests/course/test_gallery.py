"""Long pictures: visible from the first samples on, continued after an interruption, never mixed with another."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from harness.api import render
from harness.course.gallery import STEP, Picture, render_picture
from harness.errors import StoreError
from harness.samples.exr import read_estimate
from harness.scene import Scene, load_scene

SPHERES = Path(__file__).parents[2] / "mitsuba_scenes" / "spheres.xml"
SPP = 2 * STEP + 5


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A small image."""
    return load_scene(SPHERES, width=24, height=16)


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


def test_a_picture_is_the_render_of_its_samples(scene: Scene, tmp_path: Path) -> None:
    """Rendered in steps or in one go: the same samples."""
    picture = render_picture(scene, SPP, tmp_path)
    assert (picture.samples, picture.resumed, picture.rejected) == (SPP, 0, 0)
    np.testing.assert_allclose(read_estimate(picture.exr)[0].mean, render(scene, "mixture", SPP).mean, rtol=2e-6)


def test_it_can_be_looked_at_after_the_first_sample(scene: Scene, tmp_path: Path) -> None:
    """The first state is saved at once, as a PNG of the picture's size."""
    states: list[Picture] = []
    render_picture(scene, SPP, tmp_path, saved=states.append)
    assert states[0].samples == 1
    assert Image.open(states[0].png).size == (scene.width, scene.height)


def test_an_interrupted_picture_goes_on_where_it_was(scene: Scene, tmp_path: Path) -> None:
    """Nothing rendered is lost, nothing is rendered twice, and the result is that of an uninterrupted render."""
    with pytest.raises(KeyboardInterrupt):
        render_picture(scene, SPP, tmp_path / "a", progress=lambda total, words: interrupted_after(STEP))
    kept = read_estimate(tmp_path / "a" / "spheres.exr")[0].samples
    assert STEP <= kept < SPP
    resumed = render_picture(scene, SPP, tmp_path / "a")
    assert (resumed.samples, resumed.resumed) == (SPP, kept)
    whole = render_picture(scene, SPP, tmp_path / "b")
    np.testing.assert_allclose(read_estimate(resumed.exr)[0].mean, read_estimate(whole.exr)[0].mean, rtol=2e-6)


def test_a_finished_picture_stays_as_it_is(scene: Scene, tmp_path: Path) -> None:
    """Asked again for as many samples or fewer, nothing is rendered or written; a lost PNG is made again."""
    first = render_picture(scene, 4, tmp_path)
    before = first.exr.stat().st_mtime_ns
    assert render_picture(scene, 3, tmp_path).samples == 4
    assert first.exr.stat().st_mtime_ns == before
    first.png.unlink()
    assert render_picture(scene, 4, tmp_path).png.exists()


def _shallower(folder: Path) -> Scene:
    """A file of the same name, with shorter paths."""
    folder.mkdir()
    text, deep = SPHERES.read_text(encoding="utf-8"), '<integer name="max_depth" value="6"/>'
    assert deep in text
    (folder / SPHERES.name).write_text(text.replace(deep, deep.replace("6", "2")), encoding="utf-8")
    return load_scene(folder / SPHERES.name, width=24, height=16)


def test_another_picture_is_never_continued(scene: Scene, tmp_path: Path) -> None:
    """Another size or depth under the same name is refused, as is a file that is no picture of ours."""
    render_picture(scene, 2, tmp_path)
    for other in (load_scene(SPHERES, width=24, height=17), _shallower(tmp_path / "other")):
        with pytest.raises(StoreError, match="another picture"):
            render_picture(other, 2, tmp_path)
    (tmp_path / "spheres.exr").write_bytes(b"not an image")
    with pytest.raises(StoreError, match="not an OpenEXR file"):
        render_picture(scene, 2, tmp_path)
