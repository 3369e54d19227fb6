"""The pictures that defects make of a scene: rendered by our tracer once, kept in the store, and each picture once."""

from __future__ import annotations

import os
import random
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from harness.diagnosis.causes.catalogue import Defect, Picture, defective, load_defects
from harness.diagnosis.causes.drawn import Drawn
from harness.diagnosis.causes.match import Seen
from harness.progress import Advance
from harness.samples.estimate import Batch, Estimate, merge
from harness.samples.keys import digest
from harness.samples.store import Store
from harness.scene import SceneFile, load
from harness.shader.library import GENERATED, OURS

# A picture is drawn in so many batches of so many samples per pixel: its noise is then below that of most images that
# are asked about, and four batches, with neighbouring pixels, tell how large it is.
BATCHES, SPP = 4, 128
# Candidates' streams of random numbers, far from those that anybody's replicas are numbered by.
FIRST_REPLICA = 1 << 24
# The strategy that the right picture is drawn with: the least noisy.
RIGHT = Picture("mixture", ())


@dataclass(frozen=True, eq=False)
class Candidate:
    """A picture of the scene, and the defects that make it, the first of the catalogue first; none: the right picture.

    `strategy`: that which it was drawn with.
    """

    defects: tuple[Defect, ...]
    strategy: str
    estimate: Estimate

    @cached_property
    def seen(self) -> Seen:
        """As it is compared."""
        return Seen.of(self.estimate)

    @property
    def name(self) -> str:
        """The id of the first of its defects; "right" where there is none."""
        return self.defects[0].id if self.defects else "right"


def candidates(scene: SceneFile, *, store: Store | None = None, defects: Sequence[Defect] | None = None,
               pixels: bool = True, spp: int = SPP, besides: Defect | None = None,
               advance: Advance = lambda n: None) -> list[Candidate]:
    """The right picture, and those of all defects that change it on this scene, each picture once.

    `defects`: the whole catalogue unless given. `pixels`: whether defects that are a matter of single pixels are asked
    for. `spp`: samples per pixel of each of `BATCHES` batches. `besides`: a defect that all have, the right picture
    too; those that change the same line are left out. `advance` is told of every picture as a part of all.

    A picture that is equal, bit for bit, to the right one of its strategy is of a defect that the scene has no use for,
    and is left out; one that is equal to another joins it. SceneError where our tracer cannot hold the scene.
    """
    reading = load(scene)
    wanted = [(defect, picture) for defect in applicable(scene, load_defects() if defects is None else defects)
              if pixels or not defect.pixel for picture in defect.pictures
              if besides is None or not {name for name, _ in picture.edits} & _lines(besides)]
    base = OURS if besides is None else defective(besides.pictures[0])
    strategies = dict.fromkeys([RIGHT.strategy, *(picture.strategy for _, picture in wanted)])
    share = 1.0 / (len(strategies) + len(wanted))
    found: dict[str, Candidate] = {}
    right: dict[str, str] = {}  # first batches of the right pictures, by strategy
    for strategy in strategies:
        with Drawn(scene, reading, strategy, base, store, spp, FIRST_REPLICA) as drawn:
            right[strategy] = _bits(drawn.batch(0))
            if strategy == RIGHT.strategy:
                found["right"] = Candidate((), strategy, merge(drawn.batches(BATCHES)))
        advance(share)
    # Processes that ask for one scene at a time, as in grading, begin with other pictures, and share what they draw.
    first: dict[int, str] = {}
    drawn_as: dict[str, Estimate] = {}
    for index in random.Random(os.getpid()).sample(range(len(wanted)), len(wanted)):
        _, picture = wanted[index]
        with Drawn(scene, reading, picture.strategy, defective(picture, base), store, spp, FIRST_REPLICA) as drawn:
            bits = first[index] = _bits(drawn.batch(0))
            if bits != right[picture.strategy] and bits not in drawn_as:
                drawn_as[bits] = merge(drawn.batches(BATCHES))
        advance(share)
    for index, (defect, picture) in enumerate(wanted):
        if (bits := first[index]) in found:
            found[bits] = _joined(found[bits], defect)
        elif bits in drawn_as:
            found[bits] = Candidate((defect,), picture.strategy, drawn_as[bits])
    return list(found.values())


def applicable(scene: SceneFile, defects: Sequence[Defect]) -> list[Defect]:
    """Those that the scene has what they need for. SceneError where our tracer cannot hold it."""
    code = OURS.tracer(load(scene), RIGHT.strategy).files
    generated = next(text for name, text in code if name == GENERATED)
    return [defect for defect in defects if defect.applies(generated)]


def _lines(defect: Defect) -> set[str]:
    return {name for picture in defect.pictures for name, _ in picture.edits}


def _bits(batch: Batch) -> str:
    return digest(batch.mean.astype(np.float32))


def _joined(candidate: Candidate, defect: Defect) -> Candidate:
    if defect in candidate.defects:
        return candidate
    return Candidate((*candidate.defects, defect), candidate.strategy, candidate.estimate)
