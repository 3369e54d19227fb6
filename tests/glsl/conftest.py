"""The fixtures of tests/support/scenes.py, for the tests of this folder."""

from tests.support.scenes import library_under_test, mi, scene

__all__ = ["library_under_test", "mi", "scene"]
