"""How many more samples would decide? Answered from standard errors alone, never from the error that was found."""

from __future__ import annotations

import numpy as np
from scipy import special

# The probability with which an unbiased render is to be decided by the number of samples that is asked for.
DECIDED = 0.95
# Beyond so many times the samples there is no use in saying how many.
HOPELESS = 2.0**40
# A factor from which on there is no use in saying how large it is.
MANY = 1e6


def factor_to_decide(ratios: np.ndarray, sure: float, unseen: np.ndarray | float = 0.0) -> float:
    """How many times the samples let every interval lie inside its tolerance with probability 0.95, without a bias.

    `ratios`: standard errors in tolerances, any shape; `sure`: half an interval's width in standard errors; `unseen`:
    what intervals allow for samples that have not come yet (`contrasts.PairedContrast.interval`), in tolerances, of the
    same shape. Stein's (1945) two-stage sample size, for many intervals at once by the union bound. Infinite
    where a ratio is not finite, or for more than 2^40 times.
    """
    if undecided(ratios, HOPELESS, sure, unseen) > 1 - DECIDED:
        return float("inf")
    low, high = 1 / HOPELESS, HOPELESS
    while high / low > 1.01:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if undecided(ratios, middle, sure, unseen) > 1 - DECIDED else (low, middle)
    return high


def undecided(ratios: np.ndarray, factor: float, sure: float, unseen: np.ndarray | float = 0.0) -> float:
    """The most (union bound) that the probability can be that some interval reaches beyond its tolerance.

    With `factor` times the samples; the others as in `factor_to_decide`: standard errors fall with the root of the
    samples, what is unseen with their number. Infinite where a ratio is not finite.
    """
    if not np.isfinite(ratios).all():
        return float("inf")
    with np.errstate(divide="ignore"):
        errors, unseen = ratios / np.sqrt(factor), unseen / factor
        room = (1 - unseen / 2 - np.hypot(sure * errors, unseen / 2)) / errors
    return float(2 * special.ndtr(-room).sum())


def times(factor: float) -> str:
    """A factor in words, two digits of it: 'about 3.1 times', 'about 4,700 times', never less than 1.1."""
    return f"about {float(f'{max(factor, 1.1):.2g}'):,.15g} times" if factor < MANY else "more than a million times"
