"""A scene without one of its features: what the feature does is seen, and what it costs is measured, beside that."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from harness.scene import importance
from harness.scene.bitmaps import bitmap_texels
from harness.scene.model import RGB, Bitmap, Checkerboard, EnvironmentMap, Material, Procedural, Scene, Shape, Texture


def without_lens(scene: Scene) -> Scene:
    """A pinhole: all that is in front of the camera is sharp."""
    return _with_camera(scene, aperture_radius=0.0)


def without_motion(scene: Scene) -> Scene:
    """Shapes rest where they are at time 0."""
    return _with_shapes(scene, lambda shape: dataclasses.replace(shape, motion=None))


def without_shutter(scene: Scene) -> Scene:
    """The shutter is open for a single moment, in the middle of its interval."""
    middle = sum(scene.camera.shutter) / 2
    return _with_camera(scene, shutter=(middle, middle))


def without_textures(scene: Scene) -> Scene:
    """Every texture is one colour: the mean of a bitmap's texels, of a checkerboard's two colours, of a ramp's."""
    def flat(shape: Shape) -> Shape:
        return dataclasses.replace(shape, material=_flat(shape.material),
                                   emission=None if shape.emission is None else average(shape.emission))

    return _with_shapes(scene, flat)


def without_map(scene: Scene) -> Scene:
    """The sky has the mean radiance of its map everywhere."""
    if not isinstance(scene.environment, EnvironmentMap):
        return scene
    return dataclasses.replace(scene, environment=importance.mean_radiance(scene.environment))


def without_displacement(scene: Scene) -> Scene:
    """Displaced spheres are spheres."""
    return _with_shapes(scene, lambda shape: shape if shape.displacement is None else dataclasses.replace(
        shape, kind="sphere", displacement=None))


def without_exponents(scene: Scene) -> Scene:
    """Every lobe has the exponent 1, the broadest that the handout speaks of."""
    return _with_shapes(scene, lambda shape: dataclasses.replace(
        shape, material=dataclasses.replace(shape.material, alpha=1.0)))


# Features of a scene that a tracer can leave out, by name.
FEATURES: dict[str, Callable[[Scene], Scene]] = {
    "lens": without_lens,
    "motion": without_motion,
    "shutter": without_shutter,
    "textures": without_textures,
    "environment": without_map,
    "displacement": without_displacement,
    "exponents": without_exponents,
}


def average(texture: Texture) -> RGB:
    """The one colour that stands for a texture; see `without_textures`. SceneError where a bitmap's file changed."""
    match texture:
        case Bitmap():
            colors = bitmap_texels(texture).reshape(-1, 3)
        case Checkerboard():
            colors = np.array([texture.color0, texture.color1])
        case Procedural():
            colors = np.array(texture.colors)
        case _:
            return texture
    red, green, blue = colors.mean(axis=0, dtype=np.float64)
    return float(red), float(green), float(blue)


def _flat(material: Material) -> Material:
    alpha = material.alpha if isinstance(material.alpha, float | int) else average(material.alpha)[0]
    return dataclasses.replace(material, kd=average(material.kd), ks=average(material.ks), alpha=alpha)


def _with_camera(scene: Scene, **changed: Any) -> Scene:
    return dataclasses.replace(scene, camera=dataclasses.replace(scene.camera, **changed))


def _with_shapes(scene: Scene, change: Callable[[Shape], Shape]) -> Scene:
    return dataclasses.replace(scene, shapes=tuple(map(change, scene.shapes)))
