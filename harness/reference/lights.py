"""The texture `surface_light` for Mitsuba 3: an image or a checkerboard as radiance where Mitsuba draws it wrongly.

Mitsuba draws points of a textured light by its texture, and goes from (u, v) to the shape. With its rectangle and disk
that works; on a cube, whose faces share one (u, v), on a cylinder and on a sphere that is turned, it does not (3.9):
floors under such lights were 86 %, 10-15 % and 1 % too dark. This texture holds the original one and says that it does
not vary, so that Mitsuba draws points of the shape evenly, and evaluates the texture there. Of points drawn on a sphere
Mitsuba does not tell (u, v), so they are found from the point itself.

Parameters: the nested texture; `kind` of the shape; `to_object`, from world to the shape's canonical object space; and
`moves`, as of `harness.reference.procedural`, with the same parameter `to_rest`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.scene.model import Bitmap, Checkerboard, Shape

PLUGIN = "surface_light"
_WRONG_IN_MITSUBA = ("sphere", "cube", "cylinder")


def needs_even_sampling(shape: Shape) -> bool:
    """Whether a shape's light is one that Mitsuba itself would draw wrongly."""
    return shape.kind in _WRONG_IN_MITSUBA and isinstance(shape.emission, Bitmap | Checkerboard)


def properties(mi: Any, shape: Shape, texture: Any, to_object: np.ndarray, *, moves: bool) -> Any:
    """The `mi.Properties` of this plugin around a texture, given as a `ResolvedReference`."""
    props = mi.Properties(PLUGIN)
    props["texture"] = texture
    props["kind"] = shape.kind
    props["to_object"] = mi.ScalarAffineTransform4d(to_object)
    props["moves"] = moves
    return props


def plugin_class(mi: Any) -> type:
    """The plugin's class for the current variant; a class inside a function because its base changes with that."""
    import drjit as dr

    class SurfaceLight(mi.Texture):
        def __init__(self, props: Any) -> None:
            super().__init__(props)
            self.texture = props["texture"]
            self.is_sphere = props["kind"] == "sphere"
            self.to_object = mi.AffineTransform4f(props["to_object"].matrix)
            self.to_rest = None
            if props["moves"]:
                self.to_rest = mi.AffineTransform4f()
                dr.make_opaque(self.to_rest)

        def traverse(self, callback: Any) -> None:
            if self.to_rest is not None:
                callback.put("to_rest", self.to_rest, mi.ParamFlags.NonDifferentiable)

        def _placed(self, si: Any) -> Any:
            """The interaction with the (u, v) of its point."""
            if not self.is_sphere:
                return si
            q = self.to_object @ (si.p if self.to_rest is None else self.to_rest @ si.p)
            turns = dr.atan2(q.y, q.x) * dr.inv_two_pi
            placed = mi.SurfaceInteraction3f(si)
            placed.uv = mi.Point2f(dr.select(turns < 0, turns + 1, turns),
                                   dr.atan2(dr.sqrt(q.x * q.x + q.y * q.y), q.z) * dr.inv_pi)
            return placed

        def eval(self, si: Any, active: Any = True) -> Any:
            return self.texture.eval(self._placed(si), active)

        def eval_3(self, si: Any, active: Any = True) -> Any:
            return self.texture.eval_3(self._placed(si), active)

        def eval_1(self, si: Any, active: Any = True) -> Any:
            return self.texture.eval_1(self._placed(si), active)

        def mean(self) -> Any:
            return self.texture.mean()

        def max(self) -> float:
            return float(self.texture.max())

        def is_spatially_varying(self) -> bool:
            return False

        def to_string(self) -> str:
            return f"SurfaceLight[{self.texture}]"

    return SurfaceLight
