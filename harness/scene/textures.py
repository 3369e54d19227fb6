"""Textures of a scene file: constants, bitmaps, checkerboards and procedural noise."""

from __future__ import annotations

from harness.scene.model import Texture, Varying
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
    raise node.refuse(TEXTURES)
