"""What is exported is the same tracer: drawn as each host draws, its sums are those of `harness render`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from harness.errors import HarnessError
from harness.gpu.display import display
from harness.gpu.frames import Frames, Moment
from harness.scene import Scene, load_scene
from harness.shader.exports import HOSTS, export
from harness.shader.hosts import read
from harness.shader.hosts.webgl import embedded_image
from tests.support.exported import accumulate, displayed, drawn, rendered

SCENES = Path(__file__).parents[3] / "mitsuba_scenes"
FRAMES, SAMPLES = 3, 4
# GLSL ES 3.00 has no `precise`: where the library uses it (cubes, procedural textures), compilers round otherwise.
ES = ("shadertoy", "webgl")


def scene_of(name: str) -> Scene:
    return load_scene(SCENES / f"{name}.xml", width=16, height=12)


def samples_of(host: str) -> int:
    """The plain shader keeps the library's own default."""
    return 16 if host == "glsl" else SAMPLES


def read_back(paths: list[Path], scene: Scene) -> np.ndarray:
    """The sums after `FRAMES` frames of files as the readers of strangers' shaders have them, row 0 at the top."""
    contract = read(paths)
    assert not contract.unknown
    frames = Frames(contract, (scene.width, scene.height))
    for number in range(FRAMES):
        frames.frame(Moment.of(contract.first_frame + number, number))
    found = frames.read(contract.radiance)[::-1]
    frames.release()
    return found


@pytest.mark.parametrize("host", HOSTS)
@pytest.mark.parametrize(("name", "strategy", "exact_in_es"), [
    ("cylinders", "uniform", True), ("depth_of_field", "mixture", False), ("traps/far_camera", "lobes", True),
    ("displaced", "cosine", True), ("cornell", "mis", False), ("motion_blur", "nee", False),
])
def test_sums_are_those_of_render(host: str, name: str, strategy: str, exact_in_es: bool) -> None:
    """Bit for bit; what the first frame finds in its past does not matter."""
    scene = scene_of(name)
    found = drawn(host, export(scene, strategy, host, samples=SAMPLES), scene, FRAMES)
    expected = rendered(scene, strategy, FRAMES * samples_of(host))
    if host in ES and not exact_in_es:
        np.testing.assert_allclose(found, expected, rtol=2e-5, atol=2e-5)
    else:
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("host", HOSTS)
@pytest.mark.parametrize("name", ["textures", "traps/seam"])
def test_images_are_looked_up_alike(host: str, name: str) -> None:
    """Every filter, wrap and encoding, as a sampler that is bound for them has it, to rounding; Shadertoy takes small
    images only."""
    scene = scene_of(name)
    if (host, name) == ("shadertoy", "textures"):
        with pytest.raises(HarnessError, match=r"tiles\.png.* of 10240 texels; Shadertoy takes no images of one's own"):
            export(scene, "mixture", host)
        return
    found = drawn(host, export(scene, "mixture", host, samples=SAMPLES), scene, FRAMES)
    expected = rendered(scene, "mixture", FRAMES * samples_of(host))
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4)
    if host == "glsl":
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("host", HOSTS)
def test_what_is_read_back_is_the_same(host: str, tmp_path: Path) -> None:
    """By the readers of strangers' shaders, which know nothing of ours."""
    scene = scene_of("cylinders")
    paths = []
    for name, text in export(scene, "mixture", host, samples=SAMPLES).items():
        path = tmp_path / name
        path.write_text(str(text), encoding="utf-8")
        if path.suffix != ".glsl" and not name.endswith(".display.frag"):  # the JSON holds Shadertoy's tabs
            paths.append(path)
    np.testing.assert_array_equal(read_back(paths, scene), rendered(scene, "mixture", FRAMES * samples_of(host)))


@pytest.mark.parametrize(("name", "strategy"), [("textures", "mixture"), ("environment", "mis"), ("traps/seam", "nee")])
def test_a_page_is_read_back_with_the_images_in_it(name: str, strategy: str, tmp_path: Path) -> None:
    """Bitmaps with every filter and wrap, a map, and the table by which directions are drawn from it."""
    scene = scene_of(name)
    path = tmp_path / "page.html"
    path.write_text(str(next(iter(export(scene, strategy, "webgl", samples=SAMPLES).values()))), encoding="utf-8")
    expected = rendered(scene, strategy, FRAMES * SAMPLES)
    np.testing.assert_allclose(read_back([path], scene), expected, rtol=2e-4, atol=2e-4)


@pytest.mark.parametrize(("line", "says"), [
    ('[{"sampler": "a"}]', r"page\.html:1: the images in it are damaged \('width'\); export the scene again"),
    ('[{"sampler": "a", "width": 1, "height": 1, "channels": 3, "nearest": true, "repeats": [], "texels": ""}]',
     "damaged"),
    ('[', None),  # no list: not a line of ours
])
def test_images_of_a_damaged_page_are_told(line: str, says: str | None, tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    shader = "<script type='x-shader'>void main() { gl_FragColor = vec4(1.0); }</script>"
    path.write_text(f"const IMAGES = {line};\n{shader}", encoding="utf-8")
    if says is None:
        assert read([path]).host == "webgl"
        return
    with pytest.raises(HarnessError, match=says):
        read([path])


@pytest.mark.parametrize(("sides", "texels"), [
    ((2, 2, 3), "AAAA"), ((1, 1, 1), "?"), ((-1, 1, 1), ""), ((1, "1", 1), "")])
def test_a_damaged_image_is_told_when_it_is_read(sides: tuple[int, int, int], texels: str, tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    page = dict(zip(("width", "height", "channels"), sides, strict=True))
    page |= {"sampler": "a", "nearest": True, "repeats": [False, False], "texels": texels}
    path.write_text(f"const IMAGES = [{json.dumps(page)}];\n", encoding="utf-8")
    with pytest.raises(HarnessError, match=r"damaged \(.*\); export the scene again"):
        embedded_image(path, "a")
    with pytest.raises(HarnessError, match=r"no image 'b' in it|damaged"):
        embedded_image(path, "b")


@pytest.mark.parametrize("host", HOSTS)
def test_the_picture_is_that_of_the_display_pass(host: str) -> None:
    """At the scene's exposure, to a step of 8 bits; a pixel without samples is black."""
    scene = scene_of("cylinders")
    sums = np.random.default_rng(2).uniform(0, 8, (12, 16, 4)).astype(np.float32)
    sums[0, :, 3] = 0
    shown = displayed(host, export(scene, "mixture", host, exposure=-1.5), sums)
    np.testing.assert_allclose(shown * 255, display(sums, -1.5), atol=0.51)


@pytest.mark.parametrize("host", ["shadertoy", "glslviewer"])
@pytest.mark.parametrize(("window", "corner", "size"), [((40, 12), (12, 0), (16, 12)), ((16, 20), (0, 4), (16, 12))])
def test_the_film_stands_in_the_middle_of_a_window(
    host: str, window: tuple[int, int], corner: tuple[int, int], size: tuple[int, int],
) -> None:
    """In the scene's aspect, with nothing beside it."""
    scene = scene_of("cylinders")
    files = export(scene, "mixture", host, samples=SAMPLES)
    wide = drawn(host, files, scene, FRAMES, window)
    (x, y), (width, height) = corner, size
    top = window[1] - y - height
    np.testing.assert_array_equal(wide[top:top + height, x:x + width], rendered(scene, "mixture", FRAMES * SAMPLES))
    wide[top:top + height, x:x + width] = 0
    assert not wide.any()


def test_long_paths_have_fewer_samples_a_frame() -> None:
    """Drivers leave loops of more than some ten thousand iterations without a word."""
    scene = load_scene(SCENES / "cylinders.xml", width=16, height=12, max_depth=1024)
    assert "const int SAMPLES = 32;" in export(scene, "mixture", "shadertoy", samples=1000)["buffer_a.glsl"]


def test_stale_pasts_would_show() -> None:
    """The tests above see a shader that adds to whatever its first frame finds."""
    text = "#version 420\nuniform sampler2D p; out vec4 c; void main() { c = texelFetch(p, ivec2(gl_FragCoord), 0); }"
    assert accumulate(text, (4, 4), 1, "p", lambda _: {}).min() >= 1


def test_unknown_hosts_and_strategies_are_refused() -> None:
    scene = scene_of("cylinders")
    with pytest.raises(HarnessError, match="unknown host 'quake'; choose from gratin, shadertoy, glslviewer, webgl"):
        export(scene, "mixture", "quake")
    with pytest.raises(HarnessError, match="unknown strategy 'best'"):
        export(scene, "best", "webgl")
