"""Pixels in which an author keeps something of his own, such as where the mouse was: they hold no radiance.

Nineteen of a hundred public Shadertoys that accumulate have such pixels, mostly in a corner. They do not follow the law
that all others follow, which two frames of the author's own loop show without noise.
"""

from __future__ import annotations

import numpy as np

from harness.gpu.frames import Moment
from harness.shader.contract import Law
from harness.strangers.single import FrameSource, decoded, past_weight

# The frame that is looked at, when so many are in the past: the first ones are often special.
COUNT = 2
# What a pixel may be off by from what its past and the frame alone make, relative to the image: rounding of 16-bit
# floats; and the share of pixels up to which those that are off more are an exception.
OFF, FEW = 2e-3, 0.02
# Frames in which a corner stands still, and what it is off its neighbours by, at least; each of those has to change in
# so large a part of the frames that a corner which sees what they see hardly ever stands still.
FRAMES, FAR, LIVELY = 12, 0.2, 0.8


def state_pixels(source: FrameSource, law: Law) -> np.ndarray:
    """(H, W): pixels that keep something else than radiance, rows as GL's; none where most do not follow the law."""
    width, height = source.size
    none = np.zeros((height, width), bool)
    if law.kind in ("none", "other"):
        return none
    name, first = source.contract.radiance, source.contract.first_frame
    source.clear()
    for n in range(COUNT):
        source.frame(Moment.of(first + n, n))
    past = decoded(source.read(name).astype(np.float64)[..., :3], law.encoding)
    source.frame(Moment.of(first + COUNT, COUNT))
    joined = decoded(source.read(name).astype(np.float64)[..., :3], law.encoding)
    several = [_alone(source, law, first + COUNT + later) for later in range(FRAMES)]
    alone = several[0]
    in_alpha = law.kind == "mean" and law.count in ("alpha", "inverse_alpha")
    counted = COUNT + law.offset
    weight = counted / (counted + 1) if in_alpha and counted > 0 else past_weight(law, COUNT)
    with np.errstate(invalid="ignore", over="ignore"):
        away = np.abs(joined - (weight * past + (1 - weight if in_alpha else 1.0) * alone)).max(-1)
        known = np.isfinite(away)
        size = np.abs(np.where(known, joined.max(-1), 0.0))
    off = known & (away > OFF * (size + np.median(size)))
    off = off if 0 < off.mean() <= FEW else none
    return off | _still_corners(np.stack(several))


def _alone(source: FrameSource, law: Law, number: int) -> np.ndarray:
    """What a frame leaves on an empty past, (H, W, 3)."""
    source.clear()
    source.frame(Moment.of(number, COUNT))
    pixels = decoded(source.read(source.contract.radiance).astype(np.float64)[..., :3], law.encoding)
    source.clear()
    return pixels


def _still_corners(frames: np.ndarray) -> np.ndarray:
    """(H, W): corners that never change while all pixels beside them do, (F, H, W, 3), and are far from those: a state
    that does not change follows the law of a mean as a sample without noise does."""
    found = np.zeros(frames.shape[1:3], bool)
    changes = (frames[1:] != frames[:-1]).any(-1).mean(axis=0)
    mean = frames.mean(axis=(0, 3))
    for y, x in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        beside = [(y, x + (1 if x == 0 else -1)), (y + (1 if y == 0 else -1), x),
                  (y + (1 if y == 0 else -1), x + (1 if x == 0 else -1))]
        around = [float(mean[place]) for place in beside]
        if changes[y, x] == 0 and all(changes[place] >= LIVELY for place in beside) and (
                mean[y, x] < (1 - FAR) * min(around) or mean[y, x] > (1 + FAR) * max(around)):
            found[y, x] = True
    return found
