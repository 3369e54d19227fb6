"""Which of our shapes a shape of Mitsuba's is."""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.reference.motion import moving_id
from harness.scene import Scene
from harness.scene.motion import moving


def shape_table(mi: Any, shapes: list[Any], reading: Scene) -> np.ndarray:
    """From the number under which drjit has registered a shape to its index in `reading.shapes`; -1 for no shape.

    `shapes`: all of Mitsuba's scene, in its order.
    """
    import drjit as dr

    names = {shape.name: index for index, shape in enumerate(reading.shapes) if shape.name}
    names |= {moving_id(index): index for index in moving(reading)}
    found: dict[int, int] = {}
    for position, shape in enumerate(shapes):
        pointer = int(np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0])
        found[pointer] = names.get(shape.id(), position)
    table = np.full(max(found, default=0) + 1, -1)
    table[list(found)] = list(found.values())
    return table
