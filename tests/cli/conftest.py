"""For the commands' tests: `harness` within this process, in an empty folder, and a scene that costs nothing."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from harness.cli import main

# Every path sees the sky at once, so each renderer is exact with one sample and every strategy is the same.
SKY = """<!-- Nothing but sky. -->
<scene version="3.0.0">
    <integrator type="path"><integer name="max_depth" value="2"/></integrator>
    <sensor type="perspective">
        <film type="hdrfilm">
            <integer name="width" value="16"/> <integer name="height" value="12"/>
            <float name="exposure" value="-1"/> <rfilter type="box"/>
        </film>
    </sensor>
    <emitter type="constant"><rgb name="radiance" value="0.5, 0.25, 1"/></emitter>
</scene>
"""


@dataclass(frozen=True)
class Done:
    """A command that ran: its exit status, and what it printed."""

    status: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


Harness = Callable[..., Done]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in, with a cache of its own beside it."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    return folder


@pytest.fixture
def harness(capsys: pytest.CaptureFixture[str]) -> Harness:
    """harness("render", scene, "--spp", 4): the command line, without a process of its own."""
    def run(*arguments: object) -> Done:
        capsys.readouterr()
        status = main([str(argument) for argument in arguments])
        return Done(status, *capsys.readouterr())
    return run


@pytest.fixture
def sky(tmp_path: Path) -> Path:
    """A scene file that shows nothing but a constant sky."""
    path = tmp_path / "sky.xml"
    path.write_text(SKY, encoding="utf-8")
    return path


@pytest.fixture
def no_renderer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever renders fails: for what must be refused, or read back, without a sample."""
    def refuse(*arguments: object, **options: object) -> None:
        raise AssertionError("a renderer was made")

    for name in ("harness.gpu.renderer.TracerRenderer", "harness.reference.renderer.ReferenceRenderer"):
        monkeypatch.setattr(f"{name}.__init__", refuse)


def refusal(done: Done) -> str:
    """The message of a command that refused: one line on stderr, nothing on stdout, exit status 2."""
    assert done.status == 2
    assert done.out == ""
    assert done.err.startswith("harness: error: ")
    assert done.err.count("\n") == 1
    return done.err.removeprefix("harness: error: ").rstrip("\n")
