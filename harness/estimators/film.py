"""The film's size of a scene file, whoever may be able to render the rest of it."""

from __future__ import annotations

from harness.errors import SceneError
from harness.scene.file import SceneFile
from harness.scene.nodes import Node, parse
from harness.scene.sensors import DEFAULT_FILM


def film_size(scene: SceneFile) -> tuple[int, int]:
    """(width, height) in pixels: the size asked for, else that of the first sensor's film. SceneError where the file
    cannot be parsed or has no sensor."""
    if scene.size is not None:
        return scene.size
    root = Node(parse(scene.path), 0)
    for _, sensor in root.children():
        if sensor.kind == "sensor":
            film = next((node for _, node in sensor.children() if node.kind == "film"), None)
            width, height = DEFAULT_FILM
            return (film.integer("width", width), film.integer("height", height)) if film else DEFAULT_FILM
    raise SceneError(f"{scene.path}: the scene has no <sensor>; add one")
