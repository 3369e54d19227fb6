"""Scene model and loader: a Mitsuba scene file becomes a small typed `Scene`."""

from harness.scene.loader import describe, load_scene
from harness.scene.model import Camera, Material, Scene, Shape
from harness.scene.nodes import parse

__all__ = ["Camera", "Material", "Scene", "Shape", "describe", "load_scene", "parse"]
