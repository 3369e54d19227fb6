"""Fixtures of all who test GLSL: Mitsuba to compare with, and small scenes written on the spot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from harness.machine.mitsuba_runtime import use_reference_variant
from harness.scene import Scene, load_scene
from harness.shader.library import Library
from tests.support.tracer import put_to_test

# It stands back: what is seen from within a shape may be so small that the scene is given another frame, and the rays
# that probes are given are those of the file's.
SENSOR = """<sensor type="perspective"><float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0, 0, 30" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/><rfilter type="box"/></film>
    </sensor>"""
# At the origin, looking along +z, +x to the left.
AT_ORIGIN = """<sensor type="perspective"><float name="fov" value="40"/><film type="hdrfilm">
    <integer name="width" value="8"/><integer name="height" value="8"/><rfilter type="box"/></film></sensor>"""
INTEGRATOR = """<integrator type="path"><integer name="max_depth" value="4"/></integrator>"""

SceneWriter = Callable[..., Scene]


@pytest.fixture(scope="session", autouse=True)
def library_under_test(shader_library: Library) -> Library:
    """Tells tests/support/tracer.py what is tested."""
    put_to_test(shader_library)
    return shader_library


@pytest.fixture(scope="session")
def mi() -> Any:
    """Mitsuba in `llvm_ad_rgb`."""
    return use_reference_variant()


@pytest.fixture
def scene(tmp_path: Path) -> SceneWriter:
    """Writes `<scene>` around a body, and loads it: scene(body, sensor=…, integrator=…); `.path` is the file."""
    def write(body: str = "", *, sensor: str = SENSOR, integrator: str = INTEGRATOR) -> Scene:
        path = tmp_path / f"scene{len(list(tmp_path.iterdir()))}.xml"
        path.write_text(f'<scene version="3.0.0">\n{sensor}\n{integrator}\n{body}\n</scene>\n', encoding="utf-8")
        return load_scene(path)
    return write
