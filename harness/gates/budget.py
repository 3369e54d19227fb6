"""Is a budget large enough to decide? Answered from the variance of the first look, never from its error."""

from __future__ import annotations

import numpy as np
from scipy import special

from harness.stats.bias import error_scale
from harness.stats.deviates import critical_deviate
from harness.stats.needed import DECIDED, factor_to_decide
from harness.stats.sequential import Sequence
from harness.stats.tiles import COARSER, TileMoments, TileSamples
from harness.stats.verdicts import DARK_TILE


def factor_needed(sequence: Sequence, test: TileSamples, reference: TileSamples, *, at_least: bool = False) -> float:
    """How many times the samples of a first look decide with probability 0.95, if there is no bias.

    Both sides are taken to grow. Stein's (1945) two-stage sample size: from the pilot's variance alone, so that the
    verdict on all samples together keeps its level. `at_least`: from the smallest variances that the pilot leaves
    possible, with simultaneous confidence 0.95; fewer samples are then too few, however the pilot fell out. Infinite
    where the variance is unknown, or more than 2^40 times.
    """
    batches = min(len(samples.samples) for samples in (test, reference) if samples.samples.sum() > 0)
    relative = [(_sigma(ours, theirs), allowed) for ours, theirs, allowed in (
        (test.whole(), reference.whole(), sequence.tolerance.mean),
        (test.coarser(COARSER), reference.coarser(COARSER), sequence.tolerance.coarse),
        (test, reference, sequence.tolerance.fine))]
    if at_least:
        relative = [(sigma * _least(batches - 1, sigma.size), allowed) for sigma, allowed in relative]
    ratios = np.concatenate([(sigma / allowed).ravel() for sigma, allowed in relative])
    sure = critical_deviate(sequence.looks.level(len(sequence.looks.samples) - 1, sequence.pass_level) / 2)
    return factor_to_decide(ratios, sure)


def _sigma(test: TileSamples, reference: TileSamples) -> np.ndarray:
    """The standard error of each tile's and channel's relative error."""
    ours, theirs = test.moments(), reference.moments()
    return np.asarray(np.sqrt(ours.variance + theirs.variance) / tile_scale(theirs))


def tile_scale(reference: TileMoments) -> np.ndarray:
    """What errors of tiles are relative to, (rows, columns, C): see `stats.verdicts.TileVerdict.error`."""
    whole = error_scale((reference.mean * reference.pixels).sum((0, 1)) / reference.pixels.sum())
    return np.asarray(np.maximum(np.abs(reference.mean), DARK_TILE * whole))


def _least(dof: int, cells: int) -> float:
    """What the standard errors of so many cells are at least, as a part of those found: χ² bound, Bonferroni."""
    return float(np.sqrt(dof / special.chdtri(dof, (1 - DECIDED) / cells)))
