"""Which shape each part of a pixel sees: what an error is sorted by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.machine.mitsuba_runtime import REFERENCE_VARIANT, use_reference_variant
from harness.reference.prepare import prepare
from harness.scene import SceneFile

NOTHING = -1


@dataclass(frozen=True, eq=False)
class Surfaces:
    """What rays through a regular grid of `side` x `side` places in each pixel meet first.

    `shape`: (H, side, W, side), an index into `names` and `materials`, or `NOTHING`; row 0 at the top. `names`,
    `materials`: what the file calls each shape and its BSDF, `shape <number>` where it has no name.
    """

    shape: np.ndarray
    names: tuple[str, ...]
    materials: tuple[str, ...]

    @property
    def pure(self) -> np.ndarray:
        """(H, W): the shape that all of a pixel sees; `MIXED` where it sees several."""
        first = self.shape[:, :1, :, :1]
        same = (self.shape == first).all((1, 3))
        return np.where(same, first[:, 0, :, 0], MIXED)


MIXED = -2


def surfaces(scene: SceneFile, side: int = 4, variant: str = REFERENCE_VARIANT) -> Surfaces:
    """What each part of a pixel sees, through the middle of the lens, at the moment at which the shutter opens.

    Raises whatever `prepare` raises.
    """
    mi = use_reference_variant(variant)
    import drjit as dr

    prepared = prepare(scene, variant)
    width, height = prepared.film.width, prepared.film.height
    y, x = np.mgrid[0:height * side, 0:width * side].reshape(2, -1)
    place = mi.Point2f(mi.Float((x + 0.5) / (width * side)), mi.Float((y + 0.5) / (height * side)))
    sensor = prepared.scene.sensors()[0]
    rays, _ = sensor.sample_ray(sensor.shutter_open(), 0.5, place, mi.Point2f(0.5))
    met: Any = prepared.scene.ray_intersect_preliminary(rays, coherent=True)
    shapes = prepared.scene.shapes()
    which = mi.Int32(NOTHING)
    for number, shape in enumerate(shapes):
        which = dr.select(met.is_valid() & (met.shape == mi.ShapePtr(shape)), number, which)
    # In one kernel: each shape by itself would trace all rays anew. Of no shapes there is one number for all.
    index = np.broadcast_to(np.array(which, dtype=int), x.shape)
    names = tuple(str(shape.id()) or f"shape {number}" for number, shape in enumerate(shapes))
    materials = tuple(str(shape.bsdf().id()) if shape.bsdf() is not None else "" for shape in shapes)
    return Surfaces(index.reshape(height, side, width, side), names, materials)
