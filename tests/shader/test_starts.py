"""Starts for students: each host reads and runs its own, all draw the same samples, and their mean is right."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.estimators.tracer import Tracer
from harness.files import data_dir
from harness.gpu.frames import Frames, Moment
from harness.scene import SceneFile
from harness.shader.hosts import read
from harness.shader.starts import HOSTS, SCENE, check_command, start
from harness.work.batches import render_estimate

SIZE = (16, 12)
FRAMES = 3


def written(folder: Path, host: str) -> list[Path]:
    """The files of a start called `mine`, in a folder."""
    files = start(host, str(folder / "mine"))
    for path, text in files.items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return list(files)


def summed(files: list[Path]) -> np.ndarray:
    """What a start leaves after FRAMES frames, (H, W, 4): the sum of radiance, and the samples in it."""
    contract = read(files)
    frames = Frames(contract, SIZE)
    try:
        for number in range(FRAMES):
            frames.frame(Moment.of(contract.first_frame + number, number))
        return frames.read(contract.radiance)
    finally:
        frames.release()


@pytest.mark.parametrize("host", HOSTS)
def test_each_host_reads_its_own_and_sums_the_same_samples(host: str, tmp_path: Path) -> None:
    """To a few roundings: dialects differ in what a driver makes of them, not in what they say."""
    found = summed(written(tmp_path, host))
    body = tmp_path / "body"
    body.mkdir()
    per_frame = {"native": 16}.get(host, 1)
    np.testing.assert_array_equal(found[..., 3], FRAMES * per_frame)
    if host != "native":  # which draws sixteen samples in each pass
        np.testing.assert_allclose(found, summed(written(body, "body")), rtol=1e-6)


@pytest.mark.parametrize("host", HOSTS)
def test_a_start_is_plain_text_that_names_its_check(host: str) -> None:
    """ASCII, so that no editor and no program stumbles over it; nothing left to be filled in; short."""
    texts = list(start(host, "mine").values())
    assert all(text.isascii() and not re.search(r"@\w+@", text) for text in texts)
    assert check_command(host, "mine") in texts[0].replace("&#xa;", "\n")
    assert len((data_dir("glsl") / "starts" / "tracer.glsl").read_text(encoding="utf-8").splitlines()) <= 120


def test_the_start_shows_its_scene(tmp_path: Path) -> None:
    """The mean of each channel and of luminance, against our tracer's; and a start without its cosine does not."""
    file, = written(tmp_path, "native")
    scene = SceneFile.bundled(SCENE, SIZE)
    wrong = tmp_path / "wrong.frag"
    wrong.write_text(file.read_text(encoding="utf-8").replace("* cos_l / pdf", "/ pdf"), encoding="utf-8")

    def estimate(tracer: Tracer) -> tuple[np.ndarray, np.ndarray]:
        with tracer.open(scene) as renderer:
            found = render_estimate(renderer, 1024)
        return found.image_mean, found.image_variance

    truth, noise = estimate(Tracer("mixture"))
    for shader, right in ((file, True), (wrong, False)):
        mean, variance = estimate(Tracer("cosine", shader=shader))
        deviations = np.abs(mean - truth) / np.sqrt(variance + noise)
        assert (deviations.max() < 5) == right, deviations


@pytest.mark.parametrize(("host", "name", "says"), [
    ("shadrtoy", "mine", "there is no host 'shadrtoy'; choose from body, gratin, shadertoy, webgl, glslviewer, native"),
    ("body", "", "'' is no name of a file"), ("body", "mine/", "'mine/' is no name of a file")])
def test_refusals(host: str, name: str, says: str) -> None:
    with pytest.raises(HarnessError, match=re.escape(says)):
        start(host, name)
