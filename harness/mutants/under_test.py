"""Puts another shader library before the tests of its functions, which ask pytest for it."""

from __future__ import annotations

import pytest

from harness.shader.library import Library

# The shader library that the tests of a run are about; ours where nobody set another.
LIBRARY: pytest.StashKey[Library] = pytest.StashKey()


class LibraryUnderTest:
    """A pytest plugin for `pytest.main`: the fixture `shader_library` of harness/pytest_plugin.py gives its library."""

    def __init__(self, library: Library) -> None:
        self._library = library

    def pytest_configure(self, config: pytest.Config) -> None:
        config.stash[LIBRARY] = self._library
