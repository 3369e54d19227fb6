"""Is a budget large enough to decide? Answered from the variance of the first look, never from its error."""

from __future__ import annotations

import numpy as np
from scipy import special

from harness.gates.model import Gate
from harness.stats.bias import error_scale
from harness.stats.contrasts import DARK_TILE
from harness.stats.deviates import critical_deviate
from harness.stats.needed import DECIDED, factor_to_decide, undecided
from harness.stats.sequential import Looking
from harness.stats.tiles import ImageMoments, TileMoments


def too_small(gate: Gate, test: ImageMoments, reference: ImageMoments) -> bool:
    """Does the first look show the gate's budget to be too small to decide? Then no more is drawn.

    It is, where even the smallest variances that the look leaves possible, with simultaneous confidence 0.95, would
    leave an unbiased render undecided more often than in 1 of 20 runs.
    """
    ratios = _ratios(gate.sequence, test, reference, at_least=True)
    return undecided(ratios, gate.replicas / gate.looks[0], _sure(gate.sequence)) > 1 - DECIDED


def factor_needed(sequence: Looking, test: ImageMoments, reference: ImageMoments) -> float:
    """How many times the samples of a first look decide with probability 0.95, if there is no bias.

    Both sides are taken to grow. Stein's (1945) two-stage sample size: from the pilot's variance alone, so that the
    verdict on all samples together keeps its level. Infinite where the variance is unknown, or more than 2^40 times.
    """
    return factor_to_decide(_ratios(sequence, test, reference), _sure(sequence))


def _ratios(sequence: Looking, test: ImageMoments, reference: ImageMoments, *, at_least: bool = False) -> np.ndarray:
    """All standard errors of a look in tolerances; `at_least`: the smallest that it leaves possible."""
    dof = min(side.fine.dof for side in (test, reference))
    allowed = sequence.tolerance.mean, sequence.tolerance.coarse, sequence.tolerance.fine
    relative = [(_sigma(*pair), bound) for *pair, bound in zip(test, reference, allowed, strict=True)]
    return np.concatenate([(sigma * (_least(dof, sigma.size) if at_least else 1.0) / bound).ravel()
                           for sigma, bound in relative])


def _sure(sequence: Looking) -> float:
    """Half the width of the last look's intervals in standard errors."""
    return critical_deviate(sequence.looks.level(len(sequence.looks.samples) - 1, sequence.pass_level) / 2)


def _sigma(test: TileMoments, reference: TileMoments) -> np.ndarray:
    """The standard error of each tile's and channel's relative error."""
    return np.asarray(np.sqrt(test.variance + reference.variance) / tile_scale(reference))


def tile_scale(reference: TileMoments) -> np.ndarray:
    """What errors of tiles are relative to, (rows, columns, C): see `stats.verdicts.TileVerdict.error`."""
    whole = error_scale((reference.mean * reference.pixels).sum((0, 1)) / reference.pixels.sum())
    return np.asarray(np.maximum(np.abs(reference.mean), DARK_TILE * whole))


def _least(dof: float, cells: int) -> float:
    """What the standard errors of so many cells are at least, as a part of those found: χ² bound, Bonferroni."""
    return float(np.sqrt(dof / special.chdtri(dof, (1 - DECIDED) / cells)))
