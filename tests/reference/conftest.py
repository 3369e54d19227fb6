"""Fixtures of the reference's tests: Mitsuba in the variant that the harness renders with."""

from __future__ import annotations

from typing import Any

import pytest

from harness.machine.mitsuba_runtime import use_reference_variant
from harness.reference.plugins import register_plugins


@pytest.fixture
def mi() -> Any:
    """Mitsuba in `llvm_ad_rgb` with the harness's plugins; set again for each test, since some switch variants."""
    mitsuba = use_reference_variant()
    register_plugins()
    return mitsuba
