"""The page: whatever a scene is called, its text stays text."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np

from harness.scene import load_scene
from harness.scene.bitmaps import bitmap_texels
from harness.shader.exports import export
from harness.shader.scene.bitmaps import images

SCENES = Path(__file__).parents[3] / "mitsuba_scenes"
NASTY = '--></title></script><script>alert("here")</script><!--'


class Elements(HTMLParser):
    """The elements of a page, and what scripts hold."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.tags.append(tag)


def tags(page: str) -> list[str]:
    parser = Elements()
    parser.feed(page)
    return parser.tags


def test_names_cannot_leave_their_comments() -> None:
    scene = load_scene(SCENES / "cylinders.xml")
    named = dataclasses.replace(scene, name=NASTY, shapes=tuple(
        dataclasses.replace(shape, name=NASTY) for shape in scene.shapes))
    (plain,), (page,) = (export(one, "mixture", "webgl").values() for one in (scene, named))
    assert tags(str(page)) == tags(str(plain))
    assert tags(str(plain)).count("script") == 3


def test_images_are_in_the_page_as_the_harness_reads_them() -> None:
    """Linear, first row first, with the filter and the wraps that their samplers are to have."""
    scene = load_scene(SCENES / "textures.xml")
    (page,) = export(scene, "mixture", "webgl").values()
    found = re.search(r"^const IMAGES = (.*);$", str(page), re.MULTILINE)
    assert found
    embedded = json.loads(found[1])
    assert [(one["sampler"], one["file"], one["nearest"], one["repeats"]) for one in embedded] == [
        ("bitmap0", "window.exr", False, [False, False]), ("bitmap1", "tiles.png", False, [True, True]),
        ("bitmap2", "leaves.png", False, [False, False]), ("bitmap3", "wear.png", True, [True, True])]
    texels = np.frombuffer(base64.b64decode(embedded[1]["texels"]), "<f4").reshape(64, 64, 3)
    np.testing.assert_array_equal(texels, bitmap_texels(images(scene.shapes)[1]))
