"""Fixtures of the tests of statistics."""

from __future__ import annotations

import numpy as np
import pytest


@pytest.fixture
def rng() -> np.random.Generator:
    """One fixed stream: the simulations are experiments that come out the same every time."""
    return np.random.default_rng(20240602)
