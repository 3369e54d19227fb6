"""The pixels of every bundled scene by every strategy, as they were written down: a rearranged house keeps them.

To write them down anew, after a change that is meant to change them: `python -m tests.test_pixels`, from the project's
folder.
"""

from __future__ import annotations

import functools
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.files import data_dir
from harness.gpu.context import describe_gl
from harness.gpu.device import ENTRY
from harness.gpu.renderer import TracerRenderer
from harness.samples.estimate import Batch
from harness.scene import Scene, load_scene
from harness.scene.strategies import DRAWS, STRATEGIES
from harness.shader.library import OURS
from harness.shader.source import ShaderSource

FILE = Path(__file__).with_name("pixels.json")
WIDTH, HEIGHT, SAMPLES = 48, 36, 64
# Other drivers sum in another order, which sends up to eight paths in a million elsewhere, one or none of an image.
# Mesa 25 draws 109 of 217 images to the bit; of the others the mean of one is 1e-5 off, of all else 7e-6 or less. Four
# paths are allowed for, of the mean's radiance. Bits are kept of one driver alone: another's would have to be drawn
# anew, on that driver, with every change that is meant to change pixels.
OTHER_DRIVER = 4 / (WIDTH * HEIGHT * SAMPLES)
# Light of which a compute shader may have more: threads that rasterise have zeros for denormal numbers.
NOTHING = 1e-36
SAMPLE_LIGHTS = [strategy for strategy in STRATEGIES if strategy not in DRAWS]
RECORDED: dict[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))
SCENES = sorted({name.split()[0] for name in RECORDED["images"]})


def bundled() -> set[str]:
    """The scenes that there are, those of the exhibits and traps too."""
    folder = data_dir("mitsuba_scenes")
    return {path.relative_to(folder).with_suffix("").as_posix() for path in folder.rglob("*.xml")}


@functools.lru_cache(maxsize=1)  # tests go through the strategies of a scene, and share what is read of its files
def loaded(scene: str) -> Scene:
    return load_scene(data_dir("mitsuba_scenes") / f"{scene}.xml", width=WIDTH, height=HEIGHT)


@functools.lru_cache(maxsize=1)
def source(scene: str, strategy: str) -> ShaderSource:
    """The shader, of which either entry makes its own program."""
    return OURS.tracer(loaded(scene), strategy)


def drawn(scene: str, strategy: str, *counts: int) -> list[Batch]:
    """Samples from 0 on of replica 0, as many as each of the counts says."""
    renderer = TracerRenderer(loaded(scene), strategy, source(scene, strategy))
    try:
        return [renderer.render_batch(0, 0, count) for count in counts]
    finally:
        renderer.release()


def written_down(batch: Batch) -> dict[str, Any]:
    """What is kept of a batch: a hash of its float32 pixels, little-endian, and the mean of each channel."""
    return {"sha256": hashlib.sha256(batch.mean.astype("<f4").tobytes()).hexdigest(),
            "mean": [float(value) for value in batch.mean.astype(np.float64).mean((0, 1))], "rejected": batch.rejected}


def computed_too(scene: str, strategy: str) -> bool:
    """Whether the compute shader draws it as well: of each scene one strategy that meets lights and one that samples
    them, in turn. It is the fragment shader with another `main`, which knows neither scene nor strategy, so both are
    gone through, not all their pairs, each of which would be compiled once more."""
    turn = SCENES.index(scene)
    return strategy in (DRAWS[turn % len(DRAWS)], SAMPLE_LIGHTS[turn % len(SAMPLE_LIGHTS)])


def test_the_compute_shader_draws_every_scene_and_strategy() -> None:
    pairs = [(scene, strategy) for scene in SCENES for strategy in STRATEGIES if computed_too(scene, strategy)]
    assert {scene for scene, _ in pairs} == set(SCENES) and len(pairs) == 2 * len(SCENES)
    assert all(sum(strategy == each for _, each in pairs) >= 5 for strategy in STRATEGIES)


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("scene", SCENES)  # the outer one
def test_pixels_are_what_they_were(scene: str, strategy: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the bit on the driver that drew them, else to a few paths' share of the mean; and by the compute shader as by
    the fragment shader, in two samples of each pixel, but for what is made of denormal numbers."""
    monkeypatch.setenv(ENTRY, "fragment")
    batch, few = drawn(scene, strategy, SAMPLES, 2)
    if computed_too(scene, strategy):
        monkeypatch.setenv(ENTRY, "compute")
        computed, = drawn(scene, strategy, 2)
        np.testing.assert_array_equal(*(np.where(image.mean < NOTHING, 0, image.mean) for image in (computed, few)))
        assert computed.rejected == few.rejected
    found, recorded = written_down(batch), RECORDED["images"][f"{scene} {strategy}"]
    if describe_gl() == RECORDED["driver"]:
        assert found == recorded
    else:
        np.testing.assert_allclose(found["mean"], recorded["mean"], rtol=OTHER_DRIVER)


def test_every_scene_is_written_down() -> None:
    assert bundled() == set(SCENES)


if __name__ == "__main__":
    images = {f"{scene} {strategy}": written_down(*drawn(scene, strategy, SAMPLES))
              for scene in sorted(bundled()) for strategy in STRATEGIES}
    FILE.write_text(json.dumps({"driver": describe_gl(), "size": [WIDTH, HEIGHT], "samples": SAMPLES,
                                "images": images}, indent=1) + "\n", encoding="utf-8")
