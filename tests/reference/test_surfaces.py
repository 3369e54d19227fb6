"""What pixels see: shapes by name, row 0 at the top, mixed where edges run."""

from __future__ import annotations

from harness.reference.surfaces import MIXED, NOTHING, surfaces
from harness.scene import SceneFile


def test_names_what_each_pixel_sees() -> None:
    seen = surfaces(SceneFile.bundled("cornell", (32, 24)))
    pure = seen.pure
    assert pure.shape == (24, 32)
    assert seen.names[pure[3, 16]] == "light"
    assert seen.names[pure[12, 6]] == "left wall"
    assert seen.names[pure[21, 12]] == "floor"
    assert seen.materials[pure[12, 6]] == "red"
    assert pure[12, 0] == NOTHING
    assert pure[12, 4] == MIXED
    assert seen.shape.shape == (24, 4, 32, 4)
