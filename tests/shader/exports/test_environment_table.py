"""Shaders that draw directions from the environment map: where the table by which they do goes, and where it cannot."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.scene import load_scene
from harness.scene.importance import sampling_table, texel_density
from harness.scene.model import EnvironmentMap
from harness.shader.exports import HOSTS, export
from tests.support.exported import drawn, rendered

SCENES = Path(__file__).parents[3] / "mitsuba_scenes"
FRAMES, SAMPLES = 2, 4
TABLES = {"nee": "environment_table", "mis": "compensated_environment_table"}


@pytest.mark.parametrize(("strategy", "table"), TABLES.items())
def test_a_page_holds_the_table(strategy: str, table: str) -> None:
    """And the pdf, as the map's alpha; its sums are those of `harness render`."""
    compensated = strategy == "mis"
    scene = load_scene(SCENES / "environment.xml", width=16, height=12)
    environment = scene.environment
    assert isinstance(environment, EnvironmentMap)
    files = export(scene, strategy, "webgl", samples=SAMPLES)
    expected = rendered(scene, strategy, FRAMES * SAMPLES)
    np.testing.assert_allclose(drawn("webgl", files, scene, FRAMES), expected, rtol=1e-4, atol=1e-4)
    found = re.search(r"^const IMAGES = (.*);$", str(next(iter(files.values()))), re.MULTILINE)
    assert found
    images = {one["sampler"]: one for one in json.loads(found[1])}
    assert list(images) == ["environment_map", table]
    assert [(one["nearest"], one["repeats"]) for one in images.values()] == [(False, [True, False]),
                                                                             (True, [False, False])]
    pixels = {name: np.frombuffer(base64.b64decode(one["texels"]), "<f4").reshape(one["height"], one["width"], 4)
              for name, one in images.items()}
    np.testing.assert_allclose(pixels["environment_map"][..., 3], texel_density(environment, compensated=compensated))
    np.testing.assert_array_equal(pixels[table], sampling_table(environment, compensated=compensated))


@pytest.mark.parametrize("host", [host for host in HOSTS if host != "webgl"])
def test_hosts_that_load_files_are_refused(host: str) -> None:
    """In one line, with what to do."""
    scene = load_scene(SCENES / "traps" / "seam.xml", width=16, height=12)
    with pytest.raises(HarnessError, match=r"^directions are drawn from the environment map by a table of numbers, .*; "
                                           r"export to webgl, or take a strategy "):
        export(scene, "nee", host)
