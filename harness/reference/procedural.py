"""The textures `fractal`, `marble` and `wood` for Mitsuba 3; their formulas are those of `harness.scene.procedural`.

Parameters, as in a scene file: `color0`, `color1`, … (colours or numbers), `octaves`, `lacunarity`, `gain`,
`frequency`, `distortion` (not of `fractal`), `seed`, `to_texture`; and `to_object`, from world to the shape's canonical
object space, which `harness.reference.expand` gives to each shape's own copy of a texture. The copies of a moving shape
also have `moves`, and `harness.reference.motion` sets their parameter `to_rest`, from where it is to where it rests.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.scene.model import RGB, Procedural, as_matrix
from harness.scene.noise import Arithmetic
from harness.scene.procedural import (
    DEFAULT_COLORS,
    DEFAULT_GAIN,
    DEFAULT_LACUNARITY,
    DEFAULT_OCTAVES,
    KINDS,
    evaluate,
    ramp,
    transformed,
)


def arithmetic(mi: Any) -> Arithmetic:
    """How `harness.scene.noise` computes with drjit's arrays of Mitsuba's current variant."""
    import drjit as dr

    # By way of Int32: a negative float has no unsigned counterpart.
    return Arithmetic(dr.floor, dr.sqrt, dr.select, lambda x: mi.UInt32(mi.Int32(x)), lambda x: mi.Float(mi.Int32(x)))


def read(props: Any) -> Procedural:
    """A texture's Mitsuba properties, with `to_object` and the frequency folded into `to_texture`, as in the shader.

    It then takes points of world space, and rounds them as the shader does: a steep texture would amplify a difference.
    """
    kind = KINDS[props.plugin_name()]
    frequency = props.get("frequency", kind.frequency)
    to_cells = np.diag([frequency] * 3 + [1.0]) @ _matrix(props, "to_texture") @ _matrix(props, "to_object")
    return Procedural(
        props.plugin_name(), _colors(props),
        octaves=props.get("octaves", DEFAULT_OCTAVES),
        lacunarity=props.get("lacunarity", DEFAULT_LACUNARITY),
        gain=props.get("gain", DEFAULT_GAIN),
        frequency=1.0,
        distortion=0.0 if kind.distortion is None else props.get("distortion", kind.distortion),
        seed=props.get("seed", 0),
        to_texture=as_matrix(to_cells))


def _matrix(props: Any, name: str) -> np.ndarray:
    value = props.get(name)
    return np.eye(4) if value is None else np.array(value.matrix, dtype=np.float64)


def _colors(props: Any) -> tuple[RGB, ...]:
    values: list[Any] = [props.get(f"color{index}", default) for index, default in enumerate(DEFAULT_COLORS)]
    while (name := f"color{len(values)}") in props:
        values.append(props[name])
    colors = (np.broadcast_to(np.ravel(np.array(value, dtype=np.float64)), 3) for value in values)
    return tuple((float(r), float(g), float(b)) for r, g, b in colors)


def plugin_class(mi: Any) -> type:
    """The plugin's class for the current variant; a class inside a function because its base changes with that."""
    import drjit as dr

    class ProceduralTexture(mi.Texture):
        def __init__(self, props: Any) -> None:
            super().__init__(props)
            if not mi.variant().endswith("_ad_rgb"):  # the hash needs arrays, and colours have three channels
                raise RuntimeError(f"{props.plugin_name()}: variant {mi.variant()} is not supported; use llvm_ad_rgb")
            self.texture = read(props)
            self.arithmetic = arithmetic(mi)
            self.to_rest = None
            if props.get("moves", False):
                self.to_rest = mi.AffineTransform4f()
                dr.make_opaque(self.to_rest)

        def traverse(self, callback: Any) -> None:
            if self.to_rest is not None:
                callback.put("to_rest", self.to_rest, mi.ParamFlags.NonDifferentiable)

        def _channels(self, si: Any, active: Any) -> Any:
            at_rest = si.p if self.to_rest is None else self.to_rest @ si.p
            p = transformed(self.texture.to_texture, (at_rest.x, at_rest.y, at_rest.z))
            t, _ = evaluate(self.arithmetic, self.texture, p)
            channels = zip(*self.texture.colors, strict=True)
            return dr.select(active, mi.Color3f(*(ramp(self.arithmetic, t, stops)[0] for stops in channels)), 0)

        def eval(self, si: Any, active: Any = True) -> Any:
            return self._channels(si, active)

        def eval_3(self, si: Any, active: Any = True) -> Any:
            return self._channels(si, active)

        def eval_1(self, si: Any, active: Any = True) -> Any:
            return mi.luminance(self._channels(si, active))

        def mean(self) -> Any:
            # Of the colours: Mitsuba asks for a rough number, by which some materials choose between lobes.
            return mi.Float(float(np.mean(self.texture.colors)))

        def max(self) -> float:
            return float(np.max(self.texture.colors))

        def is_spatially_varying(self) -> bool:
            # What Mitsuba asks by this is whether a light's texture must be sampled through the shape's (u, v), which
            # it can do for few shapes, and not for textures of space: it samples the shape instead.
            return False

        def to_string(self) -> str:
            return f"{self.texture}"

    return ProceduralTexture
