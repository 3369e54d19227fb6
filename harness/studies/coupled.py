"""How far the tracer and the oracle that draws its random numbers agree on a scene: measured for the report."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.estimators.base import Renderer
from harness.estimators.coupled import Coupled
from harness.estimators.tracer import Tracer
from harness.files import cache_dir
from harness.results import CoupledRecord
from harness.samples.estimate import Accumulator, Batch, luminance, with_luminance
from harness.samples.keys import code_digest, digest
from harness.samples.memo import Warn, remembered
from harness.samples.pictured import load_pictured, save_pictured
from harness.scene import Scene, SceneFile, file_of
from harness.scene.strategies import check_strategy
from harness.stats.agreement import differing
from harness.stats.paired import FLOAT32_FLOOR, paired_verdict
from harness.stats.tiles import TileAccumulator, tile_size
from harness.studies.memo import glsl_digest
from harness.studies.plan import exhibited_strategies
from harness.work.provenance import versions

RECORDS_FILE = "coupled.npz"
# The longer side of the image that is compared, in pixels: what differs is seen at any size.
SIDE = 96
# The strategy that suits every scene.
ALWAYS = "mixture"
# Paths of more vertices than this cost too much to follow with a second strategy.
LONG = 6
# Of samples that differ, one has parted that is off by more than this part of the image's mean.
PARTED = 0.01


@dataclass(frozen=True)
class Drawn:
    """How much is drawn: replicas of so many samples per pixel, and images of one sample."""

    replicas: int
    spp: int
    singles: int


# Enough for a mean within some ten parts in a million, in a second or two a scene.
DRAWN = Drawn(replicas=16, spp=8, singles=8)
# Where a displaced sphere's mesh, of millions of triangles, takes ten times as long.
FEWER = Drawn(replicas=12, spp=4, singles=4)


def remembered_coupled(scene: Scene, *, warn: Warn) -> tuple[tuple[CoupledRecord, ...], bool]:
    """The records of a scene, one a strategy of `strategies_of`, and whether they were measured now.

    `warn` is told of damaged ones, measured again. HarnessError where the scene is outside the oracle's reach."""
    return remembered(
        coupled_folder(scene), RECORDS_FILE, load=load_coupled, save=save_coupled, warn=warn,
        make=lambda: tuple(measure_coupled(file_of(scene), strategy, drawn_of(scene))
                           for strategy in strategies_of(scene)),
        loss="the coupled images are drawn again")


def coupled_folder(scene: Scene) -> Path:
    """Where the cache keeps those records, be they there or not."""
    key = {"scene": scene.content_hash, "name": scene.name, "strategies": strategies_of(scene),
           "drawn": dataclasses.asdict(drawn_of(scene)), "code": code_digest(__name__), "glsl": glsl_digest(),
           **versions()}
    return cache_dir() / "coupled" / digest(key, 24)


def strategies_of(scene: Scene) -> tuple[str, ...]:
    """The strategies to compare: `mixture`, and where it is cheap the first other that the report shows and that finds
    all light."""
    if _displaced(scene) or scene.max_depth > LONG:
        return (ALWAYS,)
    others = [name for name in exhibited_strategies(scene) if name != ALWAYS and check_strategy(scene, name).suits]
    return (ALWAYS, *others[:1])


def drawn_of(scene: Scene) -> Drawn:
    """How much to draw of a scene."""
    return FEWER if _displaced(scene) else DRAWN


def _displaced(scene: Scene) -> bool:
    return any(shape.displacement is not None for shape in scene.shapes)


def measure_coupled(file: SceneFile, strategy: str, drawn: Drawn = DRAWN) -> CoupledRecord:
    """Compare the tracer with its coupled oracle, at no more than `SIDE` pixels a side.

    HarnessError for an unknown strategy, SceneError for a scene outside the oracle's reach."""
    began = time.perf_counter()
    film = file.film
    scale = min(1.0, SIDE / max(film.width, film.height))
    file = file.sized(*(max(1, round(scale * side)) for side in (film.width, film.height)))
    with Tracer(strategy).open(file) as test, Coupled(strategy).open(file) as reference:
        return _compared(file.name, strategy, test, reference, drawn, began)


def _compared(scene: str, strategy: str, test: Renderer, reference: Renderer, drawn: Drawn,
              began: float) -> CoupledRecord:
    singles = [np.stack([side.render_batch(replica, 0, 1).mean for replica in range(drawn.singles)])
               for side in (test, reference)]
    image, difference = Accumulator(), Accumulator()
    tiles = [TileAccumulator(tile_size(*singles[0].shape[1:3])) for _ in range(2)]
    total = np.zeros(singles[0].shape[1:3])
    for replica in range(drawn.replicas):
        ours, theirs = (side.render_batch(replica, 0, drawn.spp) for side in (test, reference))
        image.add(ours)
        difference.add(Batch(ours.mean - theirs.mean, drawn.spp))
        total += luminance(theirs.mean)
        for tile, batch in zip(tiles, (ours, theirs), strict=True):
            largest = None if batch.largest is None else with_luminance(batch.largest)
            tile.add(with_luminance(batch.mean), batch.samples, largest)
    mean = total / drawn.replicas
    whole = float(mean.mean())
    verdict = paired_verdict(tiles[0].samples(), tiles[1].samples())
    noise, rest = (float(each.estimate().luminance_variance.mean()) for each in (image, difference))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.float64(noise) / rest if np.sqrt(noise) > FLOAT32_FLOOR * whole else np.nan
        left = luminance(difference.mean) / np.maximum(mean, PARTED * whole)
        far = ~(np.abs(singles[0] - singles[1]) <= PARTED * whole).all(axis=-1)
    apart = differing(singles[0], singles[1])
    return CoupledRecord(scene, strategy, drawn.replicas, drawn.spp, float(ratio), verdict.luminance, apart.size,
                         int(apart.sum()), int((apart & far).sum()), time.perf_counter() - began, left)


def save_coupled(records: Sequence[CoupledRecord], folder: str | Path) -> None:
    """Write records to `folder` (made if missing), maps as float32; StoreError where they cannot be written."""
    save_pictured(Path(folder) / RECORDS_FILE, records, "left")


def load_coupled(folder: str | Path) -> tuple[CoupledRecord, ...]:
    """Read records back, maps rounded to float32; StoreError where the file is missing, damaged or something else."""
    return load_pictured(Path(folder) / RECORDS_FILE, CoupledRecord, "left", "remove it and measure again")
