"""The tracer and its probes with the shader library under test: ours, or one that `harness mutants` seeded a bug into.

Tests of glsl/ and of what hosts it take `evaluate`, `TracerRenderer` and `tracer_source` from here; the fixtures of
tests/support/scenes.py say which library it is.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.gpu import display as display_pass
from harness.gpu import probes, renderer
from harness.scene import Scene
from harness.shader.library import OURS, Library
from harness.shader.source import ShaderSource

_under_test: list[Library] = [OURS]


def library() -> Library:
    """The library under test."""
    return _under_test[-1]


def put_to_test(other: Library) -> None:
    """All that follows is about this library."""
    _under_test[:] = [other]


def evaluate(probe: str, *inputs: np.ndarray, **options: Any) -> np.ndarray:
    """`harness.gpu.probes.evaluate` of the library under test."""
    return probes.evaluate(probe, *inputs, **{"library": library(), **options})


def display(image: np.ndarray, exposure: float = 0.0) -> np.ndarray:
    """`harness.gpu.display.display` of the library under test."""
    return display_pass.display(image, exposure, library())


def tracer_source(scene: Scene, strategy: str) -> ShaderSource:
    """The path tracer of the library under test."""
    return library().tracer(scene, strategy)


class TracerRenderer(renderer.TracerRenderer):
    """The tracer with the library under test."""

    def __init__(self, scene: Scene, strategy: str, source: ShaderSource | None = None) -> None:
        super().__init__(scene, strategy, source or tracer_source(scene, strategy))
