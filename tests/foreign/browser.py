"""Chromium without a window, asked over a pipe by the DevTools protocol: pages, scripts, pointer, keys, screenshots."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome")
SECONDS = 60.0
BLOCK = 1 << 20


def chromium() -> str:
    """The browser's path; the test fails where there is none."""
    found = next(filter(None, map(shutil.which, NAMES)), None)
    assert found, "Chromium is missing; type: apt-get install -y chromium"
    return found


class Page:
    """One page of a browser; `errors`: what its scripts threw and its console complained of."""

    def __init__(self, send: int, receive: int) -> None:
        self._send, self._receive, self._rest, self._number, self._session = send, receive, b"", 0, ""
        self.errors: list[str] = []
        target = self._ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._ask(f"{domain}.enable")

    def open(self, path: Path, *, width: int = 1280, height: int = 900, dark: bool = False,
             scripts: bool = True) -> None:
        """Show a file at a size in CSS pixels, as a system that prefers light or dark has it."""
        self._ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self._ask("Emulation.setEmulatedMedia", media="",
                  features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}])
        self._ask("Emulation.setScriptExecutionDisabled", value=not scripts)
        self._ask("Page.navigate", url=path.as_uri())
        self.wait("document.readyState === 'complete'")

    def print(self) -> None:
        """Set the page for paper from now on, until another is opened."""
        self._ask("Emulation.setEmulatedMedia", media="print")

    def run(self, script: str) -> Any:
        """The value of an expression in the page, awaited."""
        answer = self._ask("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, condition: str) -> None:
        """Until an expression in the page is true."""
        end = time.monotonic() + SECONDS
        while not self.run(f"Boolean({condition})"):
            assert time.monotonic() < end, f"never true: {condition}"
            time.sleep(0.05)

    def place(self, selector: str) -> tuple[float, float, float, float]:
        """Left, top, width and height of an element in the window, once it was scrolled into view."""
        box = f"document.querySelector({json.dumps(selector)})"
        self.run(f"{box}.scrollIntoView({{block: 'center', behavior: 'instant'}})")
        found = self.run(f"(b => [b.left, b.top, b.width, b.height])({box}.getBoundingClientRect())")
        return found[0], found[1], found[2], found[3]

    def pointer(self, kind: str, x: float, y: float, **more: Any) -> None:
        """`kind`: Moved, Pressed, Released or Wheel, at a place in the window."""
        pressed = {"button": "left", "clickCount": 1} if kind in ("Pressed", "Released") else {}
        self._ask("Input.dispatchMouseEvent", type=f"mouse{kind}", x=x, y=y, **{**pressed, **more})

    def drag(self, x: float, y: float, to_x: float, to_y: float) -> None:
        """With the left button, in four steps."""
        self.pointer("Pressed", x, y)
        for step in range(1, 5):
            self.pointer("Moved", x + (to_x - x) * step / 4, y + (to_y - y) * step / 4, button="left", buttons=1)
        self.pointer("Released", to_x, to_y)

    def key(self, key: str) -> None:
        """A key that is pressed and let go."""
        for kind in ("keyDown", "keyUp"):
            self._ask("Input.dispatchKeyEvent", type=kind, key=key, **({"text": key} if len(key) == 1 else {}))

    def screenshot(self, path: Path, *, whole: bool = False) -> None:
        """What the window shows, or the whole page, as PNG."""
        data = self._ask("Page.captureScreenshot", format="png", captureBeyondViewport=whole)["data"]
        path.write_bytes(base64.b64decode(data))

    def _ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The answer to a command; events that come before it are noted."""
        self._number += 1
        session = {"sessionId": self._session} if self._session else {}
        message = {"id": self._number, "method": method, "params": parameters, **session}
        os.write(self._send, json.dumps(message).encode() + b"\0")
        while True:
            told = self._read()
            if told.get("id") == self._number:
                assert "error" not in told, f"{method}: {told.get('error')}"
                return dict(told["result"])
            self._note(told.get("method", ""), told.get("params", {}))

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            block = os.read(self._receive, BLOCK)
            assert block, "Chromium ended"
            self._rest += block
        message, _, self._rest = self._rest.partition(b"\0")
        return dict(json.loads(message))

    def _note(self, event: str, told: dict[str, Any]) -> None:
        if event == "Runtime.exceptionThrown":
            self.errors.append(str(told["exceptionDetails"]))
        elif event == "Log.entryAdded" and told["entry"]["level"] == "error":
            self.errors.append(told["entry"]["text"])
        elif event == "Network.requestWillBeSent" and not told["request"]["url"].startswith(("file:", "data:")):
            self.errors.append(f"asked for {told['request']['url']}")


@contextmanager
def browser(profile: Path) -> Iterator[Page]:
    """A page of a browser with an empty profile in a folder, which ends with the block."""
    to_browser, send = os.pipe()
    receive, from_browser = os.pipe()

    # It reads commands from file 3 and writes answers to file 4; a shell puts them there, whatever their numbers are.
    line = f'exec "$0" "$@" 3<&{to_browser} 4>&{from_browser}'
    process = subprocess.Popen(
        ["bash", "-c", line, chromium(), "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu",
         "--hide-scrollbars", "--remote-debugging-pipe", f"--user-data-dir={profile}"],
        pass_fds=(to_browser, from_browser), stderr=subprocess.DEVNULL)
    os.close(to_browser)
    os.close(from_browser)
    try:
        yield Page(send, receive)
    finally:
        os.close(send)  # it ends when its commands do
        with suppress(subprocess.TimeoutExpired):
            process.wait(10)
        process.kill()
        process.wait()
        os.close(receive)
