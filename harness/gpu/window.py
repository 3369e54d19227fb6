"""A window on the screen that shows one image, and tells which keys were pressed in it."""

from __future__ import annotations

import os
import sys
from typing import Any

import moderngl
import numpy as np

from harness.errors import MachineError
from harness.gpu.context import Program, adopt, context
from harness.shader.library import OURS

# What installs the extra `view`, in whichever environment this is.
INSTALL = f"{sys.executable} -m pip install 'moderngl-window>=3.1'"
# Keys that are told, by what moderngl-window calls them.
KEYS = {**{letter: letter.lower() for letter in "QRS"}, "LEFT": "left", "RIGHT": "right", "UP": "up", "DOWN": "down",
        "PAGE_UP": "page up", "PAGE_DOWN": "page down", "SPACE": "space", "ESCAPE": "escape"}
# A window is made larger by whole numbers while its width is below this, so that pixels of small films can be seen.
ROOM = 640
# As the tracer's own context.
GL_VERSION = 4, 3


class Window:
    """A window whose GL context becomes this thread's: the tracer draws in it as it does without one."""

    def __init__(self, size: tuple[int, int], title: str) -> None:
        """Open it, for images of `size` (width, height). MachineError where the extra `view` is missing, or a
        display."""
        kind = _kind()
        self.scale = max(1, ROOM // size[0])
        try:
            self._window: Any = kind(title=title, size=(size[0] * self.scale, size[1] * self.scale),
                                     gl_version=GL_VERSION, vsync=False, resizable=True)
        except Exception as error:  # pyglet and moderngl raise whatever their platform's layers do
            raise MachineError(f"the window cannot be opened ({_reason(error)}); {_mend()}") from None
        adopt(self._window.ctx)
        self._window.exit_key = None  # would destroy the window while its events are read
        self._window.key_event_func = self._note
        names = vars(type(self._window).keys) if hasattr(type(self._window), "keys") else {}
        self._names = {names[name]: word for name, word in KEYS.items() if name in names}
        self._pressed: list[str] = []
        self._program = Program(OURS.assembled("display.frag"))
        self._texture: moderngl.Texture | None = None

    @property
    def closed(self) -> bool:
        """Whether the user closed it."""
        return bool(self._window.is_closing)

    def name(self, title: str) -> None:
        """Set its title."""
        self._window.title = title

    def keys(self) -> list[str]:
        """The keys pressed since this was asked last, among KEYS, oldest first."""
        pressed, self._pressed = self._pressed, []
        return pressed

    def show(self, image: np.ndarray, exposure: float = 0.0) -> None:
        """Show a mean (H, W, 3) of linear radiance, row 0 at the top, by display.frag at an exposure in stops; then
        take up what the user did."""
        self._draw(image, exposure)
        self._window.swap_buffers()

    def pixels(self, image: np.ndarray, exposure: float = 0.0) -> np.ndarray:
        """What `show` puts into the window's framebuffer, (H, W, 3) uint8 of its own size, row 0 at the top."""
        self._draw(image, exposure)
        screen = self._window.fbo
        width, height = self._window.buffer_size
        found = np.frombuffer(screen.read((0, 0, width, height), components=3, alignment=1), dtype=np.uint8)
        return np.ascontiguousarray(found.reshape(height, width, 3)[::-1])

    def close(self) -> None:
        """Close it, and with it this thread's GL context."""
        self._program.release()
        if self._texture is not None:
            self._texture.release()
        self._window.close()

    def _draw(self, image: np.ndarray, exposure: float) -> None:
        height, width = image.shape[:2]
        gl = context()
        if self._texture is None or self._texture.size != (width, height):
            if self._texture is not None:
                self._texture.release()
            self._texture = gl.texture((width, height), 4, dtype="f4")
            self._texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        texels = np.ones((height, width, 4), dtype=np.float32)
        texels[..., :3] = image[::-1]
        self._texture.write(texels.tobytes())
        self._texture.use(0)
        self._window.use()
        gl.viewport = (0, 0, *self._window.buffer_size)
        gl.scissor = None
        self._program.set({"pingpong0": 0, "exposure": exposure})
        self._program.draw()

    def _note(self, key: Any, action: Any, modifiers: Any) -> None:
        if action == self._window.keys.ACTION_PRESS and key in self._names:
            self._pressed.append(self._names[key])


def _kind() -> Any:
    """moderngl-window's class of windows."""
    try:
        import moderngl_window
    except ImportError as error:
        if error.name != "moderngl_window":
            raise MachineError(f"a window needs the package '{error.name}'; type: {INSTALL}") from None
        raise MachineError(f"a window needs the package moderngl-window; type: {INSTALL}") from None
    try:
        return moderngl_window.get_local_window_cls()  # pyglet's, or that of $MODERNGL_WINDOW
    except Exception as error:  # where there is no display, its packages fail while they are imported
        raise MachineError(f"the window cannot be opened ({_reason(error)}); {_mend()}") from None


def _reason(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _mend() -> str:
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return "there is no display: set DISPLAY, or type `xvfb-run harness view ...` for a virtual one"
    return "it takes a display with OpenGL 4.3; on Debian or Ubuntu type: apt-get install -y libgl1 libgl1-mesa-dri"
