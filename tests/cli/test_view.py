"""`harness view`: what it opens, and what it says where there is no window to be had."""

from __future__ import annotations

import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.gpu import window
from tests.cli.conftest import Harness, refusal


class Closed:
    """A window that its user closes after so many pictures."""

    pictures = 2
    opened: list[tuple[tuple[int, int], str]] = []  # noqa: RUF012
    shown: list[np.ndarray] = []  # noqa: RUF012

    def __init__(self, size: tuple[int, int], title: str) -> None:
        self.opened[:] = [(size, title)]
        self.shown.clear()
        self.is_open = True

    @property
    def closed(self) -> bool:
        return len(self.shown) >= self.pictures

    def name(self, title: str) -> None:
        self.title = title

    def keys(self) -> list[str]:
        return ["s"] if len(self.shown) == self.pictures - 1 else []

    def show(self, image: np.ndarray, exposure: float = 0.0) -> None:
        self.shown.append(image)

    def close(self) -> None:
        self.is_open = False


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch) -> type[Closed]:
    monkeypatch.setattr(window, "Window", Closed)
    return Closed


def test_a_scene_is_watched_with_the_strategy_asked_for(harness: Harness, sky: Path, screen: type[Closed]) -> None:
    done = harness("view", sky, "--strategy", "uniform", "-o", "saved")
    assert done.status == 0
    assert screen.opened == [((16, 12), "sky")] and len(screen.shown) == 2
    np.testing.assert_allclose(screen.shown[-1], np.broadcast_to([0.5, 0.25, 1.0], (12, 16, 3)))
    assert done.out.startswith("sky | uniform | ") and "-1 stops" in done.out
    assert sorted(path.name for path in Path("saved").iterdir()) == ["sky-uniform-1spp.exr", "sky-uniform-1spp.png"]


def test_it_is_held_against_what_the_cache_has(harness: Harness, sky: Path, screen: type[Closed]) -> None:
    assert "no reference" in harness("view", sky).out
    harness("reference", sky, "--spp", 4)
    assert harness("view", sky, "--json").json["mean_error"] == pytest.approx(0, abs=1e-6)
    harness("reference", sky, "--spp", 4, "-o", "truth.exr")
    assert harness("view", sky, "--no-cache", "--reference", "truth.exr", "--json").json["rmse"] < 1e-6


def test_a_shader_is_watched_on_the_film_of_its_scene(harness: Harness, screen: type[Closed]) -> None:
    harness("new-shader", "mine", "--host", "body")
    done = harness("view", "mine.glsl", "--size", "16x12")
    assert done.status == 0 and done.out.startswith("mine | ") and "no reference" in done.out
    assert screen.opened[0][0] == (16, 12) and 0.1 < screen.shown[-1].mean() < 1


@pytest.mark.parametrize(("arguments", "says"), [
    (("nowhere.xml",), "nowhere.xml: no such scene file"), (("nowhere.frag",), "nowhere.frag: no such file"),
    (("{sky}", "--strategy", "best"), "unknown strategy 'best'")])
def test_refusals(harness: Harness, sky: Path, screen: type[Closed], arguments: tuple[str, ...], says: str) -> None:
    assert says in refusal(harness("view", *(word.format(sky=sky) for word in arguments)))


def lacking(harness: Harness, sky: Path) -> str:
    """The one line of a machine that lacks something."""
    done = harness("view", sky)
    assert done.status == 3 and done.out == "" and done.err.count("\n") == 1, done.err
    return done.err


def test_without_the_extra_it_says_what_installs_it(
    harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "moderngl_window", None)
    assert lacking(harness, sky) == (f"harness: error: a window needs the package moderngl-window; type: "
                                     f"{sys.executable} -m pip install 'moderngl-window>=3.1'\n")


@pytest.mark.parametrize("fails", ["when it is imported", "when it is opened"])
def test_without_a_display_it_says_so(
    harness: Harness, sky: Path, monkeypatch: pytest.MonkeyPatch, fails: str,
) -> None:
    def refuse(*arguments: Any, **options: Any) -> Any:
        raise RuntimeError('Cannot connect to "None"')

    package = types.ModuleType("moderngl_window")
    package.get_local_window_cls = refuse if "imported" in fails else lambda: refuse  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "moderngl_window", package)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert lacking(harness, sky).endswith(
        'the window cannot be opened (Cannot connect to "None"); there is no display: set DISPLAY, or type `xvfb-run '
        "harness view ...` for a virtual one\n")
