"""Fixtures of the report's tests: the synthetic study results of tests/support/report.py, made once."""

from __future__ import annotations

from types import ModuleType

import pytest

from harness.results import StudyResult
from tests.support import report


@pytest.fixture(scope="session")
def synthetic() -> ModuleType:
    """`study_result`, `exact_study` and what they are made of."""
    return report


@pytest.fixture(scope="session")
def study() -> StudyResult:
    """Four strategies that pass or are undecided, and `phong`, which does not suit."""
    return report.study_result("spheres")


@pytest.fixture(scope="session")
def exact() -> StudyResult:
    """A study against a closed form in which `cosine` has no noise."""
    return report.exact_study()
