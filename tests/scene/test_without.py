"""Scenes without one of their features: what is left out is, and nothing else."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from harness.scene import Scene, SceneFile, load
from harness.scene.bitmaps import bitmap_texels
from harness.scene.model import Bitmap, Checkerboard, EnvironmentMap, Procedural
from harness.scene.without import FEATURES, average


def scene(name: str) -> Scene:
    return load(SceneFile.bundled(name))


@pytest.mark.parametrize(("feature", "name"), [
    ("lens", "depth_of_field"), ("motion", "motion_blur"), ("shutter", "motion_blur"), ("textures", "textures"),
    ("textures", "procedural"), ("environment", "environment"), ("displacement", "displaced"), ("exponents", "plates")])
def test_another_image_of_the_scene_that_has_it_and_the_same_of_one_that_has_not(feature: str, name: str) -> None:
    changed, plain = FEATURES[feature](scene(name)), scene("diffuse")
    assert changed.content_hash != scene(name).content_hash
    assert FEATURES[feature](changed) == changed, "once is enough"
    if feature != "exponents":  # which a diffuse surface has as well, to no effect
        assert FEATURES[feature](plain) == plain


@pytest.mark.parametrize(("feature", "name", "left"), [
    ("lens", "depth_of_field", lambda one: one.camera.aperture_radius == 0),
    ("motion", "motion_blur", lambda one: not any(shape.motion for shape in one.shapes)),
    ("displacement", "displaced", lambda one: {shape.kind for shape in one.shapes} == {"rectangle", "sphere"}),
    ("exponents", "plates", lambda one: {shape.material.alpha for shape in one.shapes} == {1.0}),
    ("environment", "environment", lambda one: not isinstance(one.environment, EnvironmentMap)),
])
def test_it_is_gone(feature: str, name: str, left: Callable[[Scene], bool]) -> None:
    before = scene(name)
    after = FEATURES[feature](before)
    assert not left(before) and left(after)
    for field in dataclasses.fields(Scene):
        if field.name not in ("camera", "shapes", "environment"):
            assert getattr(after, field.name) == getattr(before, field.name)
    assert [shape.to_world for shape in after.shapes] == [shape.to_world for shape in before.shapes]


def test_a_closed_shutter_sees_the_middle_of_its_interval() -> None:
    start, end = scene("motion_blur").camera.shutter
    assert FEATURES["shutter"](scene("motion_blur")).camera.shutter == ((start + end) / 2,) * 2 and start < end


def test_a_flat_colour_is_the_mean_of_its_texture() -> None:
    def textures(one: Scene) -> list[Any]:
        return [texture for shape in one.shapes for texture in (
            shape.material.kd, shape.material.ks, shape.material.alpha, shape.emission)
            if isinstance(texture, Bitmap | Checkerboard | Procedural)]

    found = {type(texture): texture for name in ("textures", "procedural") for texture in textures(scene(name))}
    assert average(found[Bitmap]) == pytest.approx(np.mean(bitmap_texels(found[Bitmap]), (0, 1), np.float64))
    board = found[Checkerboard]
    assert average(board) == pytest.approx(np.mean([board.color0, board.color1], axis=0))
    assert average(found[Procedural]) == pytest.approx(np.mean(found[Procedural].colors, axis=0))
    assert not textures(FEATURES["textures"](scene("textures")))
