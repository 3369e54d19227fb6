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
from harness.scene.model import RGB, EnvironmentMap
from harness.shader.exports import HOSTS, export
from harness.shader.scene import chunk
from harness.shader.scene.environment import environment_function, sampling_functions
from harness.shader.scene.literals import function
from tests.support.exported import drawn, rendered

SCENES = Path(__file__).parents[3] / "mitsuba_scenes"
FRAMES, SAMPLES = 2, 4
COMPENSATED = {"environment_table": False, "compensated_environment_table": True}


def drawing(environment: RGB | EnvironmentMap, compensated: bool) -> list[str]:
    """An environment that shows of each direction what is drawn by it."""
    assert isinstance(environment, EnvironmentMap)
    lines = [line.replace("vec3 environment(", "vec3 seen(") for line in environment_function(environment)]
    shown = ["float pdf;", "vec3 l = sample_environment(0.5 + 0.49 * d.x, 0.5 + 0.49 * d.yz, pdf);",
             "return seen(l) + vec3(pdf, pdf_environment(d), 0.0);"]
    return [*lines, *sampling_functions(environment, compensated=compensated),
            *function("vec3 environment(vec3 d)", shown)]


@pytest.mark.parametrize("table", COMPENSATED)
def test_a_page_holds_the_table(monkeypatch: pytest.MonkeyPatch, table: str) -> None:
    """And the pdf, as the map's alpha; its sums are those of `harness render`."""
    compensated = COMPENSATED[table]
    monkeypatch.setattr(chunk, "environment_function", lambda environment: drawing(environment, compensated))
    scene = load_scene(SCENES / "environment.xml", width=16, height=13 + compensated)  # no other's in the cache
    environment = scene.environment
    assert isinstance(environment, EnvironmentMap)
    files = export(scene, "mixture", "webgl", samples=SAMPLES)
    expected = rendered(scene, "mixture", FRAMES * SAMPLES)
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
def test_hosts_that_load_files_are_refused(monkeypatch: pytest.MonkeyPatch, host: str) -> None:
    """In one line, with what to do."""
    monkeypatch.setattr(chunk, "environment_function", lambda environment: drawing(environment, False))
    scene = load_scene(SCENES / "traps" / "seam.xml", width=16, height=12)
    with pytest.raises(HarnessError, match=r"^directions are drawn from the environment map by a table of numbers, .*; "
                                           r"export to webgl, or take a strategy "):
        export(scene, "mixture", host)
