"""`harness view` on a virtual display: what is on the screen is what is rendered without one, and keys reach it.

Needs the extra `view` and Xvfb, so it is not one of `make test`'s: .ci/extras runs it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from harness.estimators.tracer import Tracer
from harness.gpu.context import describe_gl
from harness.gpu.display import display
from harness.scene import SceneFile

SIZE = (32, 24)
# Watches until some pictures were shown, then presses keys as the window's own package hands them on; waits in between
# for the parent to look at the screen.
PROGRAM = """
import json, sys
from harness.cli.view import _tracers
from harness.gpu.context import describe_gl
from harness.gpu.window import Window
from harness.view.session import Session, Watched
from harness.view.loop import watch
import numpy as np
from pathlib import Path

subject = _tracers(Path(sys.argv[1]), "mixture", "32x24", None)
window = Window((32, 24), "x")
native = window._window._window
batches = []

with Session(subject.scene, subject.estimators, Watched(subject.first, 0.5), folder=Path(sys.argv[2])) as session:
    for _ in range(4):
        before = session.samples
        session.advance()
        batches.append((before, session.samples - before))
        window.name(session.title)
        window.show(session.image, session.chosen.exposure)
    np.save(Path(sys.argv[2]) / "image.npy", session.image)
    window.show(session.image, session.chosen.exposure)
    print(json.dumps({"batches": batches, "at": native.get_location(), "scale": window.scale, "gl": describe_gl(),
                      "caption": native.caption}), flush=True)
    sys.stdin.readline()
    keys = window._window.keys
    for key in (keys.UP, keys.S, keys.PAGE_DOWN, keys.Q):
        native.dispatch_event("on_key_press", key, 0)
    session.paused = True
    watch(session, window)
    print(json.dumps({"exposure": session.chosen.exposure, "depth": session.chosen.depth, "done": session.done,
                      "saved": [path.name for path in session.saved], "closed": window.closed}), flush=True)
window.close()
"""


@pytest.fixture
def screen(tmp_path: Path) -> Iterator[tuple[str, Path]]:
    """The name of a virtual display, and the file in which its pixels stand."""
    read, write = os.pipe()
    server = subprocess.Popen(["Xvfb", "-displayfd", str(write), "-screen", "0", "1024x768x24", "-fbdir",
                               str(tmp_path)], pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    try:
        with os.fdopen(read) as pipe:
            number = pipe.readline().strip()
        assert number, "Xvfb did not start"
        yield f":{number}", tmp_path / "Xvfb_screen0"
    finally:
        server.terminate()
        server.wait()


def pixels(file: Path) -> np.ndarray:
    """An X window dump of 24 bits as (H, W, 3) uint8; XWDFile.h has the header's order."""
    data = file.read_bytes()
    header = np.frombuffer(data, ">u4", 25)
    size, height, width, stride, colours = header[0], header[5], header[4], header[12], header[19]
    rows = np.frombuffer(data, np.uint8, height * stride, size + 12 * colours).reshape(height, stride)
    return rows[:, :4 * width].reshape(height, width, 4)[..., 2::-1]


def test_the_screen_shows_what_is_rendered_without_one(screen: tuple[str, Path], tmp_path: Path) -> None:
    """The sums bit for bit, the picture in all 8 bits of a display; and keys do what they do."""
    name, dump = screen
    scene = SceneFile.bundled("spheres", SIZE)
    child = subprocess.Popen([sys.executable, "-c", PROGRAM, str(scene.path), str(tmp_path)], stdin=subprocess.PIPE,
                             stdout=subprocess.PIPE, text=True, env={**os.environ, "DISPLAY": name})
    assert child.stdout is not None and child.stdin is not None
    told = json.loads(child.stdout.readline())
    shown = pixels(dump)
    last, _ = child.communicate("\n", timeout=120)
    assert child.returncode == 0

    assert told["gl"] == describe_gl(), "another driver draws in windows here: its sums may differ by rounding"
    image = np.load(tmp_path / "image.npy")
    total = np.zeros((24, 32, 3))
    samples = 0
    with Tracer("mixture").open(scene) as renderer:
        for start, count in told["batches"]:
            samples += count
            total += (renderer.render_batch(0, start, count).mean - total) * (count / samples)
    np.testing.assert_array_equal(image, total)

    x, y = told["at"]
    large = np.kron(display(image, 0.5), np.ones((told["scale"],) * 2 + (1,), np.uint8))
    np.testing.assert_array_equal(shown[y:y + large.shape[0], x:x + large.shape[1]], large)
    assert told["caption"].startswith(f"spheres | mixture | {samples} spp | +0.5 stops")

    after = json.loads(last)
    assert after == {"exposure": 1.0, "depth": 5, "done": True, "closed": False,
                     "saved": [f"spheres-mixture-{samples}spp.{kind}" for kind in ("exr", "png")]}


@pytest.mark.parametrize("event", ["'on_close'", "'on_key_press', pyglet.window.key.ESCAPE, 0"])
def test_the_command_ends_where_its_window_is_closed(screen: tuple[str, Path], tmp_path: Path, event: str) -> None:
    """By the display's own means, or by Esc; what it was at is printed, and the exit status is 0."""
    name, _ = screen
    program = ("import sys, pyglet\n"
               "from harness.cli import main\n"
               "from harness.gpu import window\n"
               "class Closing(window.Window):\n"
               "    def show(self, *arguments):\n"
               "        super().show(*arguments)\n"
               f"        self._window._window.dispatch_event({event})\n"
               "window.Window = Closing\n"
               f"sys.exit(main(['view', {str(SceneFile.bundled('spheres').path)!r}, '--size', '16x12']))\n")
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, cwd=tmp_path,
                          env={**os.environ, "DISPLAY": name, "HARNESS_CACHE": str(tmp_path / "cache")})
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("spheres | mixture | ")


def test_a_display_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-m", "harness", "view", str(SceneFile.bundled("spheres").path)],
                          capture_output=True, text=True, timeout=120, cwd=tmp_path,
                          env={**{key: value for key, value in os.environ.items() if key != "DISPLAY"}})
    assert done.returncode == 3 and done.stderr.count("\n") == 1, done.stderr
    assert "there is no display: set DISPLAY, or type `xvfb-run harness view ...`" in done.stderr
