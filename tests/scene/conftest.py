"""Fixtures of the loader's tests: Mitsuba to compare with, and scene files written on the spot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from harness.machine.mitsuba_runtime import use_reference_variant
from harness.reference.plugins import register_plugins

SENSOR = """<sensor type="perspective"><float name="fov" value="40"/><film type="hdrfilm">
<integer name="width" value="8"/><integer name="height" value="6"/><rfilter type="box"/></film></sensor>"""
INTEGRATOR = '<integrator type="path"><integer name="max_depth" value="4"/></integrator>'

FileWriter = Callable[..., Path]


@pytest.fixture(scope="session")
def mi() -> Any:
    """Mitsuba in `llvm_ad_rgb` with the harness's plugins."""
    mitsuba = use_reference_variant()
    register_plugins()
    return mitsuba


@pytest.fixture
def write(tmp_path: Path) -> FileWriter:
    """Writes a scene file around a body and returns its path; the body begins on line 5 (the sensor takes 2 and 3)."""
    def scene_file(body: str = "", *, sensor: str = SENSOR, integrator: str = INTEGRATOR,
                   name: str = "scene.xml") -> Path:
        path = tmp_path / name
        path.write_text(f'<scene version="3.0.0">\n{sensor}\n{integrator}\n{body}\n</scene>\n', encoding="utf-8")
        return path
    return scene_file
