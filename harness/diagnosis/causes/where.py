"""Where an image is wrong: by the object and the material that pixels see, within surfaces and along their edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.diagnosis.causes.match import Seen
from harness.reference.surfaces import MIXED, NOTHING, surfaces
from harness.samples.estimate import LUMINANCE
from harness.scene import SceneFile

# Fewer pixels than this tell nothing.
LEAST_PIXELS = 8
# Standard errors beyond which a place counts as wrong.
SURE = 4.0


@dataclass(frozen=True)
class Place:
    """The error of all pixels of one kind, in luminance.

    `kind`: 'object', 'material', 'edges', 'background'; `name`: what the scene file calls it. `error`: found over
    reference, less 1; `sigma`: its standard error; `share`: its part of all that the image is off by, absolutely.
    """

    kind: str
    name: str
    pixels: int
    error: float
    sigma: float
    share: float

    @property
    def wrong(self) -> bool:
        """Whether the error is more than noise."""
        return abs(self.error) > SURE * self.sigma


def places(scene: SceneFile, found: Seen, reference: Seen) -> tuple[Place, ...]:
    """The error by object, by material, of the background and along edges, the surest first.

    Objects and materials by the pixels that see nothing else: those along edges change under a tiny shift of the
    camera, which is another matter than light. Raises whatever Mitsuba says of the scene.
    """
    seen = surfaces(scene)
    pure = seen.pure
    difference = (found.mean - reference.mean) @ LUMINANCE
    light = reference.mean @ LUMINANCE
    # Channels see the same paths, so their errors add up before they are squared.
    noise = (np.sqrt(found.variance + reference.variance) @ LUMINANCE) ** 2
    inflation = max(found.inflation, reference.inflation)
    groups: list[tuple[str, str, np.ndarray]] = [
        ("edges", "edges", pure == MIXED), ("background", "the background", pure == NOTHING),
        *(("object", name, pure == number) for number, name in enumerate(seen.names))]
    for material in dict.fromkeys(name for name in seen.materials if name):
        numbers = [number for number, name in enumerate(seen.materials) if name == material]
        if len(numbers) > 1:
            groups.append(("material", material, np.isin(pure, numbers)))
    whole = np.abs(difference).sum() or 1.0
    result = []
    for kind, name, mask in groups:
        total = float(light[mask].sum())
        if mask.sum() >= LEAST_PIXELS and total > 0:
            sigma = float(np.sqrt(noise[mask].sum() * inflation)) / total
            result.append(Place(kind, name, int(mask.sum()), float(difference[mask].sum()) / total, sigma,
                                float(np.abs(difference[mask]).sum() / whole)))
    return tuple(sorted(result, key=lambda place: -abs(place.error) / max(place.sigma, 1e-9)))


def told(found: Sequence[Place]) -> str:
    """The places in a sentence: what is wrong, and what is not; empty where nothing is surely wrong."""
    wrong = [place for place in found if place.wrong and place.kind != "material"]
    if not wrong:
        return ""
    shown = ", ".join(f"{place.name} {place.error:+.1%} (± {place.sigma:.1%})" for place in wrong[:3])
    right = [place.name for place in found if not place.wrong and place.kind in ("object", "background")]
    rest = f"; not on {', '.join(right[:4])}" if right else ""
    return f"off on {shown}{rest}"
