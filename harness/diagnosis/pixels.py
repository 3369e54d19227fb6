"""Which way up a picture is, and how its rays are spread about their pixels, found by what is seen along edges.

Both are found first: they look like physics to every test of a mean, and hide the physics that is wrong besides.
Whatever else is wrong with a picture, its edges lie where its rays met them: of the footprints that somebody's camera
may have, one explains the pixels that several things are seen in, and all others are off there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter

from harness.diagnosis.causes.catalogue import Defect, load_defects
from harness.samples.estimate import Estimate, luminance
from harness.scene.footprint import BOX, Footprint

# A pixel counts where some footprint changes it by so much of its value, and by so many standard errors.
CHANGED, CERTAIN = 0.05, 6.0
# Pixels that it takes.
LEAST_PIXELS = 12
# Side of the window, in pixels, in which a picture may be brighter or darker than the reference: what else is wrong.
AROUND = 5
# What is left of the absolute differences, of the usual footprint's, where another is told: half-pixel shifts leave a
# tenth of them, and a camera that is right leaves all others larger differences.
LEFT = 0.6
# A picture of each is drawn with this part of the reference's samples.
PART = 4
# What may be done to a whole picture, as it goes on after "right but for".
TURNS: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "left and right exchanged": lambda image: image[:, ::-1], "the image upside down": lambda image: image[::-1],
    "the image turned by half a turn": lambda image: image[::-1, ::-1]}
# Correlation of a picture's luminance with the reference's, turned, at the least, and how much better it must be: the
# mirror images of a scene that is nearly symmetrical are all alike.
ALIKE, BETTER = 0.6, 0.2


@dataclass(frozen=True)
class Spread:
    """The footprint that was found: the defect of the catalogue that has it, and what of the absolute differences along
    edges it leaves, relative to those of a box one pixel wide."""

    defect: Defect
    left: float

    @property
    def footprint(self) -> Footprint:
        """The defect's, which has one."""
        assert self.defect.footprint is not None
        return self.defect.footprint


@dataclass(frozen=True)
class View:
    """How a picture is held against the reference: turned first, by one of TURNS, and the reference with its spread."""

    turn: str = ""
    spread: Spread | None = None

    def turned(self, image: np.ndarray) -> np.ndarray:
        """An image (H, W, …) the reference's way up."""
        return TURNS[self.turn](image) if self.turn else image

    @property
    def footprint(self) -> Footprint:
        """That which the reference is drawn with."""
        return self.spread.footprint if self.spread else BOX

    @property
    def is_usual(self) -> bool:
        """Whether nothing is out of the ordinary."""
        return not self.turn and self.spread is None


USUAL = View()


def find_turn(found: np.ndarray, truth: np.ndarray) -> str:
    """What a picture (H, W, 3) was turned by, where it resembles the reference much more once that is undone."""
    from scipy.stats import rankdata  # half a second of imports, which the report need not wait for

    own, other = (rankdata(luminance(image)).reshape(image.shape[:2]) for image in (found, truth))
    alike = {"": _alike(own, other), **{says: _alike(turn(own), other) for says, turn in TURNS.items()}}
    best = max(alike, key=lambda says: alike[says])
    return best if best and alike[best] > max(ALIKE, alike[""] + BETTER) else ""


def _alike(one: np.ndarray, other: np.ndarray) -> float:
    """The correlation of ranks: a wrong estimator leaves most of the order of bright and dark. 0 for a picture that is
    the same everywhere, which has no order."""
    if not (np.ptp(one) and np.ptp(other)):
        return 0.0
    return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])


def known() -> list[Defect]:
    """The defects that are footprints and nothing else."""
    return [defect for defect in load_defects() if defect.footprint is not None]


def find_spread(found: Estimate, truth: Estimate, seen: Callable[[Footprint], Estimate]) -> Spread | None:
    """Which of the known footprints a picture was drawn with; None where the usual one explains it as well.

    `truth`: the reference; `seen`: it as rays of another footprint see it.
    """
    box, own = luminance(truth.mean), luminance(found.mean)
    pictures = [(defect, seen(defect.footprint)) for defect in known() if defect.footprint is not None]
    matters = np.zeros(box.shape, bool)
    for _, picture in pictures:
        away = np.abs(luminance(picture.mean) - box)
        noise = np.sqrt(picture.luminance_variance + truth.luminance_variance)
        matters |= away > np.maximum(CHANGED * np.abs(box), CERTAIN * noise)
    if matters.sum() < LEAST_PIXELS:
        return None
    usual = _off(own, box, matters)
    left = {defect.id: _off(own, luminance(picture.mean), matters) for defect, picture in pictures}
    best = min((defect for defect, _ in pictures), key=lambda defect: left[defect.id])
    return Spread(best, left[best.id] / usual) if left[best.id] < LEFT * usual else None


def _off(found: np.ndarray, picture: np.ndarray, matters: np.ndarray) -> float:
    """The absolute differences of those pixels, once the picture is as bright around each as what was found is."""
    own, other = (uniform_filter(image, AROUND, mode="nearest") for image in (found, picture))
    gain = np.divide(own, other, out=np.ones_like(own), where=other > 0)
    return float(np.abs(found - gain * picture)[matters].sum())
