"""How a scene is shown: what its file says, or leaves to the renderers, that no light depends on."""

from __future__ import annotations

from dataclasses import dataclass

from harness.scene.file import SceneFile
from harness.scene.nodes import Node
from harness.scene.sensors import load_sensor


@dataclass(frozen=True)
class Presentation:
    """What a report, a picture and a warning need to know of a scene besides the `Scene`.

    `exposure` (stops): the fixed one at which display metrics and pictures see it. `strategies`: those with which a
    report studies it, all that suit where none are named. `notes`: a sentence for each thing of the file that both
    renderers replace.
    """

    exposure: float = 0.0
    strategies: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def present(file: SceneFile) -> Presentation:
    """The presentation of a scene that `load` takes. SceneError where its sensor or integrator is not one of ours."""
    root = Node(file.parsed(), 0)
    shown = Presentation()
    for _, node in root.children():
        if node.kind == "sensor":
            sensor = load_sensor(node, *(file.size or (None, None)))
            shown = Presentation(sensor.exposure, shown.strategies, sensor.notes)
        elif node.kind == "integrator":
            named = tuple(name.strip() for name in node.string("strategies", "").split(",") if name.strip())
            shown = Presentation(shown.exposure, named, shown.notes)
    return shown
