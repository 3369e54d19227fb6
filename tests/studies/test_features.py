"""What the report shows of a feature beside its study: drawn without it, kept, and read back."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.report.chapters.features import sides_of
from harness.samples.store import Store
from harness.scene import Scene, SceneFile, load
from harness.studies import features
from harness.studies.features import (
    EQUAL,
    FOOTPRINT,
    IMAGES_FILE,
    draw,
    estimator,
    features_folder,
    remembered_features,
)

# A lamp before a black sky: every ray meets the one or the other.
LAMP = """<scene version="3.0.0">
    <integrator type="path"><integer name="max_depth" value="1"/></integrator>
    <sensor type="perspective"><float name="fov" value="30"/>
        <transform name="to_world"><lookat origin="0.03, 0.02, 5" target="0.03, 0.02, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="12"/>
            <rfilter type="box"/></film>
    </sensor>
    <shape type="disk"><emitter type="area"><rgb name="radiance" value="1, 1, 1"/></emitter></shape>
</scene>"""


@pytest.fixture
def lamp(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Scene:
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    (tmp_path / "lamp.xml").write_text(LAMP, encoding="utf-8")
    return load(SceneFile(tmp_path / "lamp.xml"))


def test_rays_through_centres_know_no_grey(lamp: Scene) -> None:
    """Edges are steps from black to white; where pixels are averaged they are not."""
    hard, soft = draw(lamp, FOOTPRINT, None), draw(lamp, "uniform", None)
    assert set(np.unique(hard.image)) == {0.0, 1.0} and len(np.unique(soft.image)) > 4
    assert (hard.samples, soft.samples) == (features.SPP, EQUAL)
    y, x = np.mgrid[0:12, 0:16] + 0.5
    extent = 5 * np.tan(np.radians(15)) * np.stack([(x - 8) / 8, (y - 6) / 8])
    away = np.hypot(extent[0] + 0.03, extent[1] - 0.02)
    np.testing.assert_array_equal(hard.image[..., 0] == 1, away < 1)


def test_pictures_are_kept_and_damaged_ones_drawn_again(lamp: Scene, tmp_path: Path,
                                                       monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    store, sides = Store(tmp_path / "samples"), ("uniform", "lens")
    first, fresh = remembered_features(lamp, sides, store, warn=said.append)
    assert fresh and [image.side for image in first] == ["uniform", "lens"]
    drawn = features.draw
    monkeypatch.setattr(features, "draw", lambda *given: pytest.fail("drawn again"))
    again, fresh = remembered_features(lamp, sides, store, warn=said.append)
    assert not fresh and not said
    for one, other in zip(first, again, strict=True):
        np.testing.assert_allclose(one.image, other.image, rtol=1e-6)
        assert dataclasses.replace(one, image=other.image).samples == other.samples
    monkeypatch.setattr(features, "draw", drawn)
    (features_folder(lamp, sides) / IMAGES_FILE).write_bytes(b"PK")
    assert remembered_features(lamp, sides, store, warn=said.append)[1]
    assert len(said) == 1 and said[0].endswith("the pictures are drawn again")


def test_a_side_that_is_none_is_refused(lamp: Scene) -> None:
    with pytest.raises(HarnessError, match="no feature 'lense' to leave out; there are footprint, lens, "):
        estimator(lamp, "lense")


def test_what_is_drawn_suits_the_scene_without_the_feature() -> None:
    """Lights are looked for where there are any left: an even sky is none."""
    assert estimator(load(SceneFile.bundled("environment")), "environment").strategy == "mixture"
    assert estimator(load(SceneFile.bundled("textures")), "textures").strategy == "mis"


@pytest.mark.parametrize("name", ["spheres", "depth_of_field", "motion_blur", "procedural", "textures", "environment",
                                  "displaced", "plates", "cornell"])
def test_the_report_shows_something_of_each_of_these(name: str) -> None:
    scene = load(SceneFile.bundled(name))
    assert sides_of(name) and all(estimator(scene, side).check(scene.file) == "" for side in sides_of(name)
                                  if side != "uniform")
