"""Where in and about its pixel a ray goes: a box one pixel wide, unless somebody's camera does otherwise."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Footprint:
    """How rays are spread about a pixel's centre.

    `width`: of the box that they are drawn from evenly, in pixels, 0 for no spread at all. `right`, `down`: how far the
    box's middle is off the pixel's. `tent`: they are drawn from a tent of that width instead, the sum of two boxes half
    as wide.
    """

    width: float = 1.0
    right: float = 0.0
    down: float = 0.0
    tent: bool = False


# What the reference's pixels are: the mean over their square.
BOX = Footprint()
