"""Coupled estimators without a renderer: pairs of batches that differ by rounding, and by rare samples that part."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from harness.stats.synthetic import Plan, draw, normal
from harness.stats.tiles import TileSamples

# Relative standard deviation of what rounding makes of a sample: glossy paths of several bounces (diffuse ones 1e-7).
ROUNDING = 1e-5
# Samples lie between none and twice their mean; a lamp's are so many times as bright as the mean.
EVEN, LAMP = 2.0, 34.0
# Partings come at silhouettes: in every tenth tile, on diagonals.
SILHOUETTES = 10

# Jumps of so many samples that part, in means of their tile: (rng, count) -> (count,).
Jumps = Callable[[np.random.Generator, int], np.ndarray]


@dataclass(frozen=True)
class Parting:
    """What samples that part are off by. `largest`: no jump is larger; `mean`: of the signed jumps."""

    jumps: Jumps
    largest: float
    mean: float


def _even(rng: np.random.Generator, count: int) -> np.ndarray:
    return EVEN * (rng.random(count) - rng.random(count))


def _lamps(rng: np.random.Generator, count: int) -> np.ndarray:
    return LAMP * rng.choice([-1.0, 1.0], count)


def _bright(rng: np.random.Generator, count: int) -> np.ndarray:
    return np.full(count, EVEN)


# A sample is replaced by another one; by one that hits a lamp, or misses it; always by the largest, to one side alone.
PARTINGS = {"even": Parting(_even, EVEN, 0.0), "lamps": Parting(_lamps, LAMP, 0.0), "bright": Parting(_bright, EVEN,
                                                                                                      EVEN)}


def draw_pair(parting: Parting, plan: Plan, expected: float, rng: np.random.Generator, *,
              drift: np.ndarray | float = 0.0) -> tuple[TileSamples, TileSamples]:
    """Test and reference of an image as `synthetic.draw` has it, of which so many samples are `expected` to part.

    The number is that of the whole image in all batches. `drift`: what is added to all samples of the test, relative,
    a number or an array (rows, columns). The test's true relative bias is `drift` plus `bias`.
    """
    reference = draw(normal, plan, rng)
    truth = _truth(plan)
    samples = plan.tile**2 * plan.spp
    relative = drift + ROUNDING / np.sqrt(samples) * rng.standard_normal(reference.means.shape[:3])
    counts = rng.poisson(expected / plan.batches * at_silhouettes(plan), relative.shape)
    where = np.repeat(np.flatnonzero(counts), counts[counts > 0])
    jumps = np.bincount(where, parting.jumps(rng, where.size), counts.size).reshape(counts.shape) / samples
    largest = np.broadcast_to(parting.largest * truth, reference.means.shape)
    test = reference.means + (relative + jumps)[..., None] * truth
    return (dataclasses.replace(reference, means=test, brightest=largest),
            dataclasses.replace(reference, brightest=largest))


def bias(parting: Parting, plan: Plan, expected: float) -> tuple[float, np.ndarray]:
    """The relative bias that partings make on average: of the image's mean, and of each tile (rows, columns)."""
    tiles = expected * at_silhouettes(plan) * parting.mean / (plan.tile**2 * plan.spp * plan.batches)
    truth = _truth(plan)[..., 0]
    return float((tiles * truth).mean() / truth.mean()), tiles


def at_silhouettes(plan: Plan) -> np.ndarray:
    """The share of partings that falls on each tile, (rows, columns)."""
    across = plan.side // plan.tile
    mask = (np.add.outer(np.arange(across), np.arange(across)) % SILHOUETTES == 0).astype(np.float64)
    return mask / mask.sum()


def _truth(plan: Plan) -> np.ndarray:
    across = plan.side // plan.tile
    return np.broadcast_to(np.geomspace(0.2, 2.0, across)[:, None], (across, across, 4))
