"""The GL context: one a thread, none across a fork, and a clear line where there is no driver."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest

from harness.errors import MachineError
from harness.gpu.context import Program, context, describe_gl
from harness.shader.source import ShaderSource


def in_thread(work: Any) -> Any:
    """What `work()` returns or raises in a thread of its own."""
    results: list[Any] = []

    def run() -> None:
        try:
            results.append(work())
        except BaseException as error:
            results.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return results[0]


def test_a_thread_keeps_its_context() -> None:
    """The same one at every call; another thread has another."""
    assert context() is context()
    assert in_thread(context) is not context()


@pytest.mark.parametrize("before", [np.nan, np.inf, 3e38])
def test_what_a_target_held_leaves_no_trace(before: float) -> None:
    """Draws replace: nothing of an earlier image shows, not even where it was not finite."""
    gl = context()
    source = "#version 420 core\nout vec4 color;\nvoid main() { color = vec4(-5.25, -0.0, 1e-42, 2.0); }\n"
    texture = gl.texture((24, 16), 4, dtype="f4", data=np.full((16, 24, 4), before, np.float32).tobytes())
    framebuffer, program = gl.framebuffer([texture]), Program(ShaderSource(source, (("fill.frag", source),)))
    framebuffer.use()
    program.draw()
    drawn = np.frombuffer(texture.read(), np.uint32).reshape(-1, 4)
    expected = np.array([-5.25, -0.0, 1e-42, 2.0], np.float32).view(np.uint32)
    np.testing.assert_array_equal(drawn, np.broadcast_to(expected, drawn.shape))
    for each in (program, framebuffer, texture):
        each.release()


def test_the_driver_is_described() -> None:
    """Renderer, version and vendor, none empty."""
    described = describe_gl()
    assert set(described) == {"gl_renderer", "gl_version", "gl_vendor"} and all(described.values())


def test_a_missing_driver_is_a_machine_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line with the packages to install, whatever EGL had to say."""
    def fail(*args: Any, **kwargs: Any) -> None:
        raise Exception("(detect) libEGL.so.1:\n cannot open shared object file")

    monkeypatch.setattr(moderngl, "create_context", fail)
    error = in_thread(context)
    assert isinstance(error, MachineError)
    assert str(error) == ("no headless OpenGL 4.3: (detect) libEGL.so.1: cannot open shared object file; on Debian or "
                          "Ubuntu type: apt-get install -y libegl1 libgl1-mesa-dri")


def test_egl_without_a_driver_is_no_slip_in_a_number(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """libEGL only asks drivers, and is there where none is: the packages mend that, another number does not."""
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", str(tmp_path / "none.json"))
    program = ("from harness.gpu.context import context\nfrom harness.errors import MachineError\n"
               "try:\n    context()\nexcept MachineError as error:\n    print(error)")
    told = subprocess.run([sys.executable, "-P", "-c", program], capture_output=True, text=True, check=True).stdout
    assert re.fullmatch(r"no headless OpenGL 4\.3: .* type: apt-get install -y libegl1 libgl1-mesa-dri\n", told), told


# Python 3.12 and later warn of a fork among threads, which is what this is about.
@pytest.mark.filterwarnings("ignore:.*multi-threaded, use of fork:DeprecationWarning")
def test_a_forked_child_is_refused() -> None:
    """Drivers hang there: the child must learn it at once, and what to use instead."""
    context()
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            context()
            os.write(writer, b"no error")
        except MachineError as error:
            os.write(writer, str(error).encode())
        finally:
            os._exit(0)
    os.close(writer)
    os.waitpid(child, 0)
    with os.fdopen(reader) as pipe:
        assert "cannot use its parent's GL context; start workers with" in pipe.read()


@pytest.mark.parametrize(("number", "told"), [("99", "there is no EGL device 99; there are "), ("x", "found 'x'")])
def test_a_device_that_is_not_there_is_one_line(monkeypatch: pytest.MonkeyPatch, number: str, told: str) -> None:
    monkeypatch.setenv("HARNESS_GL_DEVICE", number)
    found = in_thread(context)
    assert isinstance(found, MachineError) and told in str(found) and "\n" not in str(found)
