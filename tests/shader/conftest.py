"""The fixtures of tests/support/scenes.py, for the tests of this folder."""

from tests.support.scenes import mi, scene

__all__ = ["mi", "scene"]
