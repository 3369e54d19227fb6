"""Our scenes as hosts' own files: readable, self-contained, and the same picture, bit for bit where their arithmetic
allows it.

To add a host: its file here, with HOST, its name, and `export(job)`, and its row in `HOSTS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from harness.errors import HarnessError
from harness.scene.model import Scene
from harness.scene.strategies import check_strategy
from harness.shader.exports import glsl, glslviewer, gratin, shadertoy, webgl
from harness.shader.exports.base import Job
from harness.shader.library import OURS, Library

Exporter = Callable[[Job], Mapping[str, str | bytes]]
HOSTS: dict[str, Exporter] = {module.HOST: module.export for module in (gratin, shadertoy, glslviewer, webgl, glsl)}
SAMPLES = 4  # per pixel and frame: a slow device still shows some frames a second


def export(scene: Scene, strategy: str, host: str, *, samples: int = SAMPLES, exposure: float = 0.0,
           library: Library = OURS) -> dict[str, str | bytes]:
    """The files of one host, by name: `scene` traced with `strategy`, `samples` per pixel in each frame.

    `exposure`: of the picture shown, in stops; what is summed has none.
    HarnessError for an unknown host or strategy, and for what the host cannot hold.
    """
    check_strategy(scene, strategy)
    if host not in HOSTS:
        raise HarnessError(f"unknown host '{host}'; choose from {', '.join(HOSTS)}")
    return dict(HOSTS[host](Job(scene, strategy, library, samples, exposure)))
