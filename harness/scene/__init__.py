"""Scene model and loader: a Mitsuba scene file becomes a small typed `Scene`."""

from harness.scene.file import Film, SceneFile
from harness.scene.loader import describe, file_of, load, load_scene
from harness.scene.model import Camera, Material, Scene, Shape
from harness.scene.nodes import parse
from harness.scene.presentation import Presentation, present

__all__ = ["Camera", "Film", "Material", "Presentation", "Scene", "SceneFile", "Shape", "describe", "file_of", "load",
           "load_scene", "parse", "present"]
