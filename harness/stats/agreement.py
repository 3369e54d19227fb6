"""How many samples of a render differ from their twins, which draw the same random numbers? A verdict on their share.

It sees what the mean does not: a lens 0.1 % too wide parts one path in 250, as often to the bright side as to the dark.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from harness.errors import HarnessError
from harness.stats.bias import POWER, Outcome, percent
from harness.stats.levels import check_level
from harness.stats.needed import DECIDED
from harness.stats.rates import Rate

# A sample differs that is off by more than this part of the larger of the two: a thousand to ten thousand times what
# rounding makes of a path that goes on, and far less than what is left of one that parts.
THRESHOLD = 1e-3
# The share of samples that may differ: of right shaders at most 5e-4 do on llvmpipe (textured glossy scenes 3e-3).
SHARE = 2e-3
# More samples than this are not worth asking for.
MOST_SAMPLES = 1 << 40


@dataclass(frozen=True)
class AgreementVerdict:
    """Of `samples` samples, `differing` were off by more than `threshold` of themselves.

    `low`, `high`: the interval of the share, exact (Clopper and Pearson 1934), at confidence 1 - `pass_level`; where
    pixels differ in their share it is wider than need be (Hoeffding 1956, "On the distribution of the number of
    successes in independent trials": a sum of unequal chances varies less than a binomial of their mean).
    `smallest_detectable`: the smallest share that these many samples are sure (probability 0.95) to fail.
    """

    outcome: Outcome
    reason: str
    tolerance: float
    threshold: float
    differing: int
    samples: int
    low: float
    high: float
    smallest_detectable: float

    @property
    def share(self) -> float:
        """Of samples that differ."""
        return self.differing / self.samples


def differing(test: ArrayLike, reference: ArrayLike, threshold: float = THRESHOLD) -> np.ndarray:
    """Which samples differ: (..., C), radiance of single samples of both -> (...), bool.

    One does where some channel is off by more than `threshold` times the larger of the two values; one that is not
    finite differs from all. HarnessError for arrays of two shapes, or a threshold outside (0, 1).
    """
    if not 0 < threshold < 1:
        raise HarnessError("samples differ by a part of themselves that lies between 0 and 1 (0.001 is 0.1 %), found "
                           f"{threshold}")
    ours, theirs = (np.asarray(side, dtype=np.float64) for side in (test, reference))
    if ours.shape != theirs.shape:
        raise HarnessError(f"expected samples that go in pairs, found arrays of {ours.shape} and {theirs.shape}")
    with np.errstate(invalid="ignore"):
        alike = np.abs(ours - theirs) <= threshold * np.maximum(np.abs(ours), np.abs(theirs))
    return np.asarray(~(alike & np.isfinite(ours) & np.isfinite(theirs)).all(axis=-1))


def agreement_verdict(test: ArrayLike, reference: ArrayLike, tolerance: float = SHARE, *, threshold: float = THRESHOLD,
                      fail_level: float = 0.01, pass_level: float = 0.05) -> AgreementVerdict:
    """Do samples (..., C) of a test differ from their twins no more often than `tolerance`, what rounding explains?

    `test`, `reference`: images of one sample per pixel, one or a stack of them, independent of each other.

    - fail: more differ than `tolerance` explains, but for a probability of `fail_level`.
    - pass: were the share as large as the tolerance, so few would differ with a probability of `pass_level` / 2.
    - inconclusive: neither.

    HarnessError as `differing` raises it, for a tolerance or a level outside (0, 1), and for no samples.
    """
    apart = differing(test, reference, threshold)
    return share_verdict(int(apart.sum()), apart.size, tolerance, threshold=threshold, fail_level=fail_level,
                         pass_level=pass_level)


def share_verdict(differing: int, samples: int, tolerance: float = SHARE, *, threshold: float = THRESHOLD,
                  fail_level: float = 0.01, pass_level: float = 0.05) -> AgreementVerdict:
    """The verdict of `agreement_verdict` once the samples that differ are counted, for instance over several images."""
    if not 0 < tolerance < 1:
        raise HarnessError(f"the share of samples that may differ must lie between 0 and 1 (0.002 is 0.2 %), found "
                           f"{tolerance}")
    check_level(fail_level)
    check_level(pass_level)
    if not 0 <= differing <= samples or samples < 1:
        raise HarnessError(f"expected some samples, and no more that differ, found {differing} of {samples}")
    low, high = Rate(differing, samples).interval(1 - pass_level)
    found = (f"{differing} of {samples} samples ({percent(differing / samples)}) differ by more than "
             f"{percent(threshold)} of themselves")
    p = _at_least(differing, samples, tolerance)
    outcome: Outcome
    if p < fail_level:
        outcome, reason = "fail", f"{found}, where {percent(tolerance)} may; by chance with probability {p:.1g}"
    elif high <= tolerance:
        outcome, reason = "pass", f"{found}, at most {percent(high)} of all, where {percent(tolerance)} may"
    else:
        outcome, reason = "inconclusive", (f"{found}, {percent(low)} to {percent(high)} of all, where "
                                           f"{percent(tolerance)} may; draw more samples")
    return AgreementVerdict(outcome, reason, tolerance, threshold, differing, samples, low, high,
                            _smallest_detectable(samples, tolerance, fail_level))


def samples_to_agree(share: float, tolerance: float = SHARE, *, pass_level: float = 0.05) -> int:
    """How many samples make a render pass with probability 0.95 of whose samples `share` differ, less than `tolerance`.

    To plan with, from what is known of a right shader: not from the share that was found in the samples to be judged.
    HarnessError for a share that is not below the tolerance.
    """
    if not 0 <= share < tolerance < 1:
        raise HarnessError(f"only a share below the tolerance can pass; found a share of {share:g} and a tolerance of "
                           f"{tolerance:g}")

    def passes(samples: int) -> bool:
        return _at_most(_most_that_pass(samples, tolerance, pass_level), samples, share) >= DECIDED

    low, high = 0, 1
    while not passes(high):
        low, high = high, 2 * high
        if high > MOST_SAMPLES:
            raise HarnessError(f"a share of {share:g} is too near to a tolerance of {tolerance:g} to tell them apart")
    while high - low > 1:  # but for the steps of whole numbers, more samples are always better
        middle = (low + high) // 2
        low, high = (low, middle) if passes(middle) else (middle, high)
    return high


def _smallest_detectable(samples: int, tolerance: float, fail_level: float) -> float:
    """The share with which the number that fails is reached with probability `POWER`; infinite where none fails."""
    low, high = 0, samples + 1  # the fewest that fail lie in (low, high]
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if _at_least(middle, samples, tolerance) < fail_level else (middle, high)
    return float(special.betaincinv(high, samples - high + 1, POWER)) if high <= samples else float("inf")


def _most_that_pass(samples: int, tolerance: float, pass_level: float) -> int:
    """Of so many samples; -1 where none may differ and there are still too few."""
    low, high = -1, samples
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if _at_most(middle, samples, tolerance) <= pass_level / 2 else (low, middle)
    return low


def _at_least(hits: int, samples: int, share: float) -> float:
    """The probability of so many hits or more."""
    return float(special.betainc(hits, samples - hits + 1, share)) if hits else 1.0


def _at_most(hits: int, samples: int, share: float) -> float:
    """The probability of so many hits or fewer."""
    return 0.0 if hits < 0 else 1.0 if hits >= samples else float(special.betaincc(hits + 1, samples - hits, share))
