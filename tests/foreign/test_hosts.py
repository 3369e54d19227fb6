"""Exports in the hosts themselves: Shadertoy's in wgpu-shadertoy, WebGL's in Chromium. Run by `make hosts`."""

from __future__ import annotations

import base64
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from harness.scene import load_scene
from harness.shader.exports import export
from tests.support.exported import rendered

ROOT = Path(__file__).parents[2]
SCENES = ROOT / "mitsuba_scenes"
SIZE = 64, 48
FRAMES, SAMPLES = 4, 4
SECONDS = 240
# Draws what is asked for before the page has finished loading, and leaves the sum in it.
PROBE = """<script>
limit = FRAMES * SAMPLES;
const result = document.createElement("pre");
while (programs && frame * SAMPLES < limit)
    draw();
if (frame) {
    gl.bindFramebuffer(gl.FRAMEBUFFER, sums[frame % 2].target);
    const data = new Float32Array(4 * canvas.width * canvas.height);
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.FLOAT, data);
    result.textContent = btoa(Array.from(new Uint8Array(data.buffer), byte => String.fromCharCode(byte)).join(""));
}
result.id = "result";
document.body.append(result);
</script>
</body>"""


@pytest.mark.parametrize("name", ["spheres", "procedural", "motion_blur"])
def test_shadertoy_agrees_in_wgpu(tmp_path: Path, name: str) -> None:
    """Every pixel's sum of 16 samples to a ten-thousandth: the same paths, rounded otherwise."""
    scene = load_scene(SCENES / f"{name}.xml", width=SIZE[0], height=SIZE[1])
    files = export(scene, "mixture", "shadertoy", samples=SAMPLES)
    json = tmp_path / "toy.json"
    json.write_text(str(files[f"{name}.json"]))
    python = os.environ.get("HARNESS_WGPU_PYTHON", sys.executable)  # one that has the extra `shadertoy`
    toy = ROOT / "tests/foreign/toy.py"
    done = subprocess.run([python, toy, json, *map(str, SIZE), str(FRAMES), tmp_path / "out.npy"], capture_output=True,
                          text=True, timeout=SECONDS, env={**os.environ, "WGPU_FORCE_OFFSCREEN": "true"}, check=False)
    assert done.returncode == 0, done.stderr
    found, expected = np.load(tmp_path / "out.npy"), rendered(scene, "mixture", FRAMES * SAMPLES)
    np.testing.assert_array_equal(found[..., 3], expected[..., 3])
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("name", ["spheres", "textures", "furnace_cube"])
def test_a_page_agrees_in_chromium(tmp_path: Path, name: str) -> None:
    """The same paths but for those few on which rounding decides otherwise, and the same mean."""
    scene = load_scene(SCENES / f"{name}.xml", width=SIZE[0], height=SIZE[1])
    page = str(export(scene, "mixture", "webgl", samples=SAMPLES)[f"{name}.html"])
    path = tmp_path / "page.html"
    path.write_text(page.replace("</body>", PROBE.replace("FRAMES", str(FRAMES))))
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    assert browser, "Chromium is missing; type: apt-get install -y chromium"
    done = subprocess.run(
        [browser, "--headless=new", "--no-sandbox", "--disable-dev-shm-usage",
         f"--user-data-dir={tmp_path / 'profile'}", "--use-gl=angle", "--use-angle=swiftshader",
         "--enable-unsafe-swiftshader", "--dump-dom", path.as_uri()],
        capture_output=True, text=True, timeout=SECONDS, check=False)
    result = re.search(r'<pre id="result">([^<]+)</pre>', done.stdout)
    assert result, re.findall(r'<span id="status">([^<]*)', done.stdout) or done.stderr
    found = np.frombuffer(base64.b64decode(result[1]), np.float32).reshape(SIZE[1], SIZE[0], 4)[::-1]
    expected = rendered(scene, "mixture", FRAMES * SAMPLES)
    np.testing.assert_array_equal(found[..., 3], expected[..., 3])
    off = np.abs(found - expected).max(axis=-1) > 1e-3 * (1 + expected.max(axis=-1))
    assert off.mean() < 0.05
    np.testing.assert_allclose(found.mean((0, 1)), expected.mean((0, 1)), rtol=2e-3)
