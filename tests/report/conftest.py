"""Fixtures of the report's tests: the synthetic study results of synthetic.py, made once."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from harness.results import StudyResult


@pytest.fixture(scope="session")
def synthetic() -> ModuleType:
    """The module synthetic.py beside this file: `study_result`, `exact_study` and what they are made of."""
    spec = importlib.util.spec_from_file_location("synthetic", Path(__file__).with_name("synthetic.py"))
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def study(synthetic: ModuleType) -> StudyResult:
    """Four strategies that pass or are undecided, and `phong`, which does not suit."""
    result = synthetic.study_result("spheres")
    assert isinstance(result, StudyResult)
    return result


@pytest.fixture(scope="session")
def exact(synthetic: ModuleType) -> StudyResult:
    """A study against a closed form in which `cosine` has no noise."""
    result = synthetic.exact_study()
    assert isinstance(result, StudyResult)
    return result
