"""The scene of most autopsies here: Mitsuba instantiates it once."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from harness.reference.coupled_steps import CoupledSteps
from harness.scene import SceneFile

SIZE = (32, 24)


@pytest.fixture(scope="session")
def spheres() -> Iterator[CoupledSteps]:
    """Mitsuba's steps of `spheres`."""
    yield CoupledSteps(SceneFile.bundled("spheres", SIZE))
