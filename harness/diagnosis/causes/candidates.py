"""The pictures that defects make of a scene: rendered by our tracer once, kept in the store, and each picture once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from harness.diagnosis.causes.catalogue import Defect, Picture, defective, load_defects
from harness.estimators.base import Renderer
from harness.estimators.tracer import Tracer
from harness.gpu.context import describe_gl
from harness.progress import Advance
from harness.samples.estimate import Batch, Estimate, merge
from harness.samples.keys import code_digest, digest
from harness.samples.store import Store
from harness.scene import Scene, SceneFile, load
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

    @property
    def name(self) -> str:
        """The id of the first of its defects; "right" where there is none."""
        return self.defects[0].id if self.defects else "right"


def candidates(scene: SceneFile, *, store: Store | None = None, defects: Sequence[Defect] | None = None,
               pixels: bool = True, spp: int = SPP, advance: Advance = lambda n: None) -> list[Candidate]:
    """The right picture, and those of all defects that change it on this scene, each picture once.

    `defects`: the whole catalogue unless given. `pixels`: whether defects that are a matter of single pixels are asked
    for. `spp`: samples per pixel of each of `BATCHES` batches. `advance` is told of every picture as a part of all.

    A picture that is equal, bit for bit, to the right one of its strategy is of a defect that the scene has no use for,
    and is left out; one that is equal to another joins it. SceneError where our tracer cannot hold the scene.
    """
    reading = load(scene)
    code = OURS.tracer(reading, RIGHT.strategy).files
    generated = next(text for name, text in code if name == GENERATED)
    wanted = [(defect, picture) for defect in (load_defects() if defects is None else defects)
              if defect.applies(generated) and (pixels or not defect.pixel) for picture in defect.pictures]
    strategies = dict.fromkeys([RIGHT.strategy, *(picture.strategy for _, picture in wanted)])
    share = 1.0 / (len(strategies) + len(wanted))
    found: dict[str, Candidate] = {}
    right: dict[str, str] = {}  # first batches of the right pictures, by strategy
    for strategy in strategies:
        with _Drawn(scene, reading, Picture(strategy, ()), store, spp) as drawn:
            right[strategy] = _bits(drawn.batch(0))
            if strategy == RIGHT.strategy:
                found["right"] = Candidate((), strategy, merge(drawn.batches()))
        advance(share)
    for defect, picture in wanted:
        with _Drawn(scene, reading, picture, store, spp) as drawn:
            bits = _bits(drawn.batch(0))
            if bits in found:
                found[bits] = _joined(found[bits], defect)
            elif bits != right[picture.strategy]:
                found[bits] = Candidate((defect,), picture.strategy, merge(drawn.batches()))
        advance(share)
    return list(found.values())


def _bits(batch: Batch) -> str:
    return digest(batch.mean.astype(np.float32))


def _joined(candidate: Candidate, defect: Defect) -> Candidate:
    if defect in candidate.defects:
        return candidate
    return Candidate((*candidate.defects, defect), candidate.strategy, candidate.estimate)


class _Drawn:
    """The batches of one picture, from the store where they are there: its shader is compiled only if one is not."""

    def __init__(self, scene: SceneFile, reading: Scene, picture: Picture, store: Store | None, spp: int) -> None:
        self._scene, self._store, self._spp = scene, store, spp
        library = defective(picture)
        self._tracer = Tracer(picture.strategy, library)
        self._key = {"renderer": "cause", "scene": reading.content_hash, "strategy": picture.strategy,
                     "shader": digest(library.tracer(reading, picture.strategy).text, 16),
                     "code": code_digest("harness.estimators.tracer"), **describe_gl()}
        self._held: dict[int, Batch] = {}

    def __enter__(self) -> _Drawn:
        self._open = ExitStack()
        self._renderer: Renderer | None = None
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def batch(self, index: int) -> Batch:
        if index not in self._held:
            replica = FIRST_REPLICA + index
            self._held[index] = self._draw(replica) if self._store is None else self._store.get_or_render(
                self._key, replica, 0, self._spp, lambda: self._draw(replica))
        return self._held[index]

    def batches(self) -> Iterator[Batch]:
        return (self.batch(index) for index in range(BATCHES))

    def _draw(self, replica: int) -> Batch:
        if self._renderer is None:
            self._renderer = self._open.enter_context(self._tracer.open(self._scene))
        return self._renderer.render_batch(replica, 0, self._spp)
