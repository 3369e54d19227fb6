"""Textures of a scene file: constants, bitmaps, checkerboards and procedural noise."""

from __future__ import annotations

from harness.errors import SceneError
from harness.scene.bitmaps import load_bitmap, load_to_uv
from harness.scene.model import RGB, Checkerboard, Texture, Varying
from harness.scene.nodes import Node
from harness.scene.procedural import KINDS, load_procedural

TEXTURES = ("bitmap", "checkerboard", *KINDS)


def load_texture(node: Node, name: str, default: float, *, emission: bool = False) -> Texture:
    """The colour or texture that property `name` holds; `default` is a grey.

    `emission`: the colour is a light's, for which a spectrum is not the same as a grey.
    """
    nested = node.nested(name)
    return node.rgb(name, default, emission=emission) if nested is None else load_varying(nested)


def load_scalar(node: Node, name: str, default: float) -> float | Varying:
    """The number or texture that property `name` holds."""
    nested = node.nested(name)
    return node.number(name, default) if nested is None else load_varying(nested)


def load_varying(node: Node) -> Varying:
    """A texture plugin."""
    if node.plugin in KINDS:
        return load_procedural(node)
    if node.plugin == "bitmap":
        return load_bitmap(node)
    if node.plugin == "checkerboard":
        return _checkerboard(node)
    raise node.refuse(TEXTURES)


def _checkerboard(node: Node) -> Checkerboard:
    board = Checkerboard(_board_color(node, "color0", 0.4), _board_color(node, "color1", 0.2), load_to_uv(node))
    node.done(["color0", "color1", "to_uv"])
    return board


def _board_color(node: Node, name: str, default: float) -> RGB:
    """A colour or a number. Mitsuba takes the colour for a reflectance, even in a light, but not the number."""
    color = node.rgb(name, default, emission=True)
    if max(color) > 1:
        try:
            node.number(name, default)
        except SceneError:
            raise node.error(f"'{name}' as a colour must not exceed 1, found {max(color):g}; Mitsuba's checkerboard "
                             "takes brighter values as a <float> only") from None
    return color
