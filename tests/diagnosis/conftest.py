"""The scenes of several autopsies here: Mitsuba instantiates each once."""

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


@pytest.fixture(scope="session")
def ladder() -> Iterator[CoupledSteps]:
    """Those of `glossy_ladder`, where exponents go from 1 to 1000."""
    yield CoupledSteps(SceneFile.bundled("glossy_ladder", (48, 36)))


@pytest.fixture(scope="session")
def plates() -> Iterator[CoupledSteps]:
    """Those of `furnace_phong`, which is seen from 400 units away."""
    yield CoupledSteps(SceneFile.bundled("furnace_phong", (48, 36)))
