"""`harness export`: whose files it writes, where, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.files import data_dir
from tests.cli.conftest import Harness

SCENES = data_dir("mitsuba_scenes")


@pytest.mark.parametrize(("host", "names"), [
    ("gratin", ["sky.gra"]), ("shadertoy", ["common.glsl", "buffer_a.glsl", "image.glsl", "sky.json"]),
    ("glslviewer", ["sky.frag"]), ("webgl", ["sky.html"]), ("glsl", ["sky.frag", "sky.display.frag"]),
])
def test_writes_a_folder_for_each_host(harness: Harness, sky: Path, here: Path, host: str, names: list[str]) -> None:
    done = harness("export", sky, "--host", host)
    assert done.status == 0
    assert done.out.splitlines() == [f"sky-{host}/{name}" for name in names]
    assert sorted(path.name for path in (here / f"sky-{host}").iterdir()) == sorted(names)


def test_one_file_goes_where_it_is_told_to(harness: Harness, sky: Path, here: Path) -> None:
    """And takes the place of an older one, as a render does."""
    (here / "page.html").write_text("old")
    assert harness("export", sky, "--host", "webgl", "-o", "page.html").out == "page.html\n"
    assert "#version 300 es" in (here / "page.html").read_text()
    assert harness("export", sky, "--host", "webgl", "-o", "pages").out == "pages/sky.html\n"


def test_takes_the_scene_as_render_does(harness: Harness, sky: Path, here: Path) -> None:
    """Its size, its depth, its exposure, and the strategy."""
    done = harness("export", sky, "--host", "webgl", "-o", "x.html", "--size", "20x10", "--max-depth", 3, "--strategy",
                   "cosine", "--samples", 2, "--json")
    assert done.json == {"files": ["x.html"], "host": "webgl", "strategy": "cosine", "scene": "sky max_depth=3",
                         "size": [20, 10]}
    page = (here / "x.html").read_text()
    for written in ('width="20" height="10"', "#define MAX_DEPTH 3", "the strategy 'cosine'", "const int SAMPLES = 2;",
                    'value="-1"'):
        assert written in page


def test_a_default_parameter_can_be_set(harness: Harness, sky: Path, here: Path) -> None:
    sky.write_text(sky.read_text().replace("<integrator", '<default name="depth" value="2"/><integrator').replace(
        'name="max_depth" value="2"', 'name="max_depth" value="$depth"'))
    assert harness("export", sky, "--host", "glsl", "-o", "out", "--set", "depth=7").status == 0
    assert "#define MAX_DEPTH 7" in (here / "out/sky_depth_7.frag").read_text()


@pytest.mark.parametrize(("scene", "options", "message"), [
    ("spheres.xml", ("--host", "quake"), "unknown host 'quake'; choose from gratin, shadertoy, glslviewer, webgl"),
    ("spheres.xml", ("--host", "webgl", "-s", "best"), "unknown strategy 'best'"),
    ("textures.xml", ("--host", "shadertoy"), "Shadertoy takes no images of one's own"),
    ("spheres.xml", ("--host", "glsl", "-o", "x.frag"), "--output: 'x.frag' is named as a file, and there are 2"),
    ("spheres.xml", (), "Missing option '--host'"),
])
def test_what_cannot_be_is_one_line_and_leaves_nothing(
    harness: Harness, here: Path, scene: str, options: tuple[str, ...], message: str,
) -> None:
    done = harness("export", SCENES / scene, *options)
    assert done.status == 2
    assert message in done.err
    assert done.err.count("\n") == 1
    assert list(here.iterdir()) == []


def test_a_strategy_that_misses_light_is_said(harness: Harness) -> None:
    done = harness("export", SCENES / "spheres.xml", "--host", "glsl", "-s", "phong")
    assert done.status == 0
    assert "warning: strategy 'phong'" in done.err
