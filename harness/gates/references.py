"""What gates are held against: Mitsuba's image as it grows, a file, or a closed form; shared by gates of one scene."""

from __future__ import annotations

import numpy as np

from harness.errors import HarnessError
from harness.gates.model import FileReference, Gate, MitsubaReference, ValueReference
from harness.progress import Advance
from harness.reference.renderer import ReferenceRenderer
from harness.samples.estimate import Estimate, with_luminance
from harness.samples.exr import read_estimate
from harness.samples.store import Store
from harness.scene import Scene
from harness.stats.tiles import TileSamples, tile_size
from harness.work.run import Run, tiles_of


class FixedReference:
    """A reference that is all there from the beginning: a file or a closed form."""

    def __init__(self, estimate: Estimate, tiles: TileSamples) -> None:
        self._estimate, self._tiles = estimate, tiles

    def grow(self, replicas: int, advance: Advance = lambda n: None) -> None:
        """Nothing to draw."""

    def tiles(self, replicas: int) -> TileSamples:
        """The same for any number of replicas."""
        return self._tiles

    def estimate(self) -> Estimate:
        """The image and its variance."""
        return self._estimate


class References:
    """The references of a run of several gates: the same scene at the same size is rendered once.

    Holds what was drawn of each, but only one of Mitsuba's scenes, that of the last gate: with 14 held, rendering a
    first look of each took 36 s of CPU time in place of 14 (see `ReferenceRenderer.release`). `store`: where Mitsuba's
    batches are kept, and looked for, between runs.
    """

    def __init__(self, store: Store | None = None) -> None:
        self._store = store
        self._runs: dict[tuple[str, int], Run] = {}

    def of(self, gate: Gate, scene: Scene) -> Run | FixedReference:
        """The reference of a gate, its scene being at the gate's size. HarnessError for a file that does not fit."""
        tile = tile_size(scene.height, scene.width)
        match gate.reference:
            case MitsubaReference(spp):
                key = scene.content_hash, spp
                self.release(but=key)
                if key not in self._runs:
                    self._runs[key] = Run(ReferenceRenderer(scene), spp, tile, self._store)
                return self._runs[key]
            case ValueReference(rgb):
                image = np.broadcast_to(np.array(rgb), (scene.height, scene.width, 3)).copy()
                return FixedReference(Estimate.exact(image), TileSamples.exact(with_luminance(image), tile))
            case FileReference():
                estimate = _read(gate, gate.reference, scene)
                return FixedReference(estimate, tiles_of(estimate, tile))

    def release(self, but: tuple[str, int] | None = None) -> None:
        """Let go of Mitsuba's scenes, but for one; what was drawn is kept, and more can be."""
        for key, run in self._runs.items():
            if key != but and isinstance(run.renderer, ReferenceRenderer):
                run.renderer.release()


def _read(gate: Gate, reference: FileReference, scene: Scene) -> Estimate:
    estimate, _ = read_estimate(reference.path)
    height, width = estimate.mean.shape[:2]
    if (height, width) != (scene.height, scene.width):
        raise gate.error(f"the reference {reference.path.name} is {width} x {height} pixels, the gate {scene.width} x "
                         f"{scene.height}; set 'size'")
    if estimate.batches and np.isnan(estimate.variance).any():
        raise gate.error(f"the reference {reference.path.name} carries no variance, so nothing can be decided; write "
                         "it with `harness reference` or harness.write_estimate")
    if not np.isfinite(estimate.mean).all():
        raise HarnessError(f"{reference.path}: holds pixels that are not finite; render it again")
    return estimate
