"""Next-event estimation and multiple importance sampling against the strategy that only meets light: the same image."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import special

from harness.estimators.tracer import Tracer
from harness.files import data_dir
from harness.samples.estimate import Estimate, merge
from harness.scene import SceneFile, load_scene
from harness.scene.lights import lights_sampled

# Scenes with a sky of one radiance alone too: `nee` samples it there, and `mis` is `mixture` to the bit.
FOLDER = data_dir("mitsuba_scenes")
NAMES = sorted(path.relative_to(FOLDER).with_suffix("").as_posix()
               for path in [*FOLDER.glob("*.xml"), *FOLDER.glob("traps/*.xml")])
SIZE = (24, 18)
BATCHES, SPP = 16, 32
# All comparisons of this file together raise a false alarm in one of a thousand changes of the seeds.
LIMIT = special.stdtrit(BATCHES - 1, 1 - 1e-3 / (2 * 2 * 3 * len(NAMES)))


def drawn(file: SceneFile, strategy: str) -> Estimate:
    with Tracer(strategy).open(file) as renderer:
        return merge(renderer.render_batch(3, number * SPP, SPP) for number in range(BATCHES))


@pytest.mark.parametrize("name", NAMES)
def test_lights_sampled_and_lights_met_make_one_image(name: str) -> None:
    """In the mean of every channel, by the scatter of batches; none of whose samples is left out."""
    path: Path = FOLDER / f"{name}.xml"
    scene = load_scene(path)
    file = SceneFile(path, size=SIZE)
    met = drawn(file, "mixture")
    for strategy in ("nee", "mis") if lights_sampled(scene, "mis") else ("nee",):
        lit = drawn(file, strategy)
        assert lit.rejected == 0
        error = np.sqrt(met.image_variance[:3] + lit.image_variance[:3])
        off = np.abs(lit.image_mean - met.image_mean)[:3]
        assert (off <= LIMIT * error + 1e-6 * met.image_mean[:3]).all(), f"{strategy}: {off / error} standard errors"
