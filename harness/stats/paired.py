"""Is a render biased against a reference that draws the same random numbers? The verdict on differences.

Batch k of the test and batch k of the reference follow the same paths up to rounding, so their difference has a
variance 10^3 to 10^14 times smaller than either, and tails as heavy as can be: one sample in a million parts from its
twin, and is then off by as much as a sample is. The mean of the differences is the difference of the means whether
paths part or not, so none is left out: a defect may sit in those that part alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from harness.errors import HarnessError
from harness.stats.bias import Outcome
from harness.stats.channels import CHANNELS
from harness.stats.contrasts import PairedContrast, PairedMoments
from harness.stats.deviates import critical_deviate
from harness.stats.levels import Looks
from harness.stats.needed import factor_to_decide
from harness.stats.tiles import COARSER, TileSamples, grouped
from harness.stats.verdicts import BiasVerdict, Tolerance, contrast_outcome, judged

# What summing 64 to 128 samples in float32 leaves, relative to the sum, and systematically: 1e-7 to 5e-7 was measured
# against closed forms. Two renderers that are both right may differ by it, and no number of samples takes it out.
FLOAT32_FLOOR = 5e-7
# What a coupled gate tolerates unless it says otherwise.
COUPLED = Tolerance(2e-5, 2e-4, 2e-3)
# What a strict one tolerates.
TIGHT = Tolerance(5e-6, 5e-5, 5e-4)


@dataclass(frozen=True)
class PairedLooking:
    """A plan as `sequential.Looking` is one, for a test and a reference that draw the same random numbers.

    `largest`: the radiance of the largest sample, of any channel or one a channel (`largest_sample`); where it is None
    the bound is what batches tell by themselves, which is up to a batch's samples per pixel times too wide.
    HarnessError for tolerances below `FLOAT32_FLOOR` and for a `largest` that is no radiance.
    """

    looks: Looks
    tolerance: Tolerance = field(default_factory=lambda: COUPLED)
    fail_level: float = 0.01
    pass_level: float = 0.05
    largest: float | tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        check_paired_tolerance(self.tolerance)
        if self.largest is not None:
            _check_largest(self.largest)

    def decide(self, look: int, test: TileSamples, reference: TileSamples) -> BiasVerdict:
        """The verdict at look number `look`, from 0; final unless it is inconclusive and a look is left."""
        return paired_verdict(test, reference, self.tolerance, largest=self.largest, fail_level=self._fail_level(look),
                              pass_level=self._pass_level(look))

    def outcome(self, look: int, test: TileSamples, reference: TileSamples) -> Outcome:
        """That of `decide`, without the rest of the verdict."""
        return self.outcome_of(look, paired(test, reference, self.largest))

    def outcome_of(self, look: int, contrasts: Iterable[PairedContrast]) -> Outcome:
        """The same from what `paired` made of them."""
        return contrast_outcome(contrasts, self.tolerance, fail_level=self._fail_level(look),
                                pass_level=self._pass_level(look))

    def factor_needed(self, test: TileSamples, reference: TileSamples) -> float:
        """How many times these samples decide at the last look with probability 0.95, if there is no bias.

        From the variance seen so far, never from the error. It knows nothing of partings that have not come, but what
        `pass` allows for them: of a first look without any it is a lower bound, of one with many an estimate.
        """
        level = self._pass_level(len(self.looks.samples) - 1)
        ratios, unseen = self._in_tolerances(paired(test, reference, self.largest), level)
        return factor_to_decide(ratios, critical_deviate(level / 2), unseen)

    def too_small(self, look: int, test: TileSamples, reference: TileSamples) -> float | None:
        """Does a look show that the budget cannot decide? Then how many times the budget would be the least; or None.

        It does where what has not come yet may alone be more than a tolerance at the budget: this falls as samples
        come and depends on no chance. Nothing is concluded from the variance: one early parting makes it many times
        too large, and the next look may be without another.
        """
        return self.too_small_of(look, paired(test, reference, self.largest))

    def too_small_of(self, look: int, contrasts: Iterable[PairedContrast]) -> float | None:
        """The same from what `paired` made of them."""
        level = self._pass_level(len(self.looks.samples) - 1)
        _, unseen = self._in_tolerances(contrasts, level)
        factor = float(unseen.max()) * self.looks.samples[look] / self.looks.samples[-1]
        return factor if factor >= 1 else None

    def _in_tolerances(self, contrasts: Iterable[PairedContrast], pass_level: float) -> tuple[np.ndarray, np.ndarray]:
        """Of all tiles and channels: standard errors, and what is unseen, in tolerances."""
        ratios, unseen = [], []
        for contrast, allowed in zip(contrasts, self.tolerance.sizes, strict=True):
            ratios.append((np.sqrt(contrast.excess(0.0).variance) / contrast.scale / allowed).ravel())
            unseen.append((contrast.unseen(pass_level) / allowed).ravel())
        return np.concatenate(ratios), np.concatenate(unseen)

    def _fail_level(self, look: int) -> float:
        return self.looks.level(look, self.fail_level)

    def _pass_level(self, look: int) -> float:
        return self.looks.level(look, self.pass_level)


def paired_verdict(test: TileSamples, reference: TileSamples, tolerance: Tolerance | None = None, *,
                   largest: ArrayLike | None = None, fail_level: float = 0.01,
                   pass_level: float = 0.05) -> BiasVerdict:
    """Is the test equivalent to a reference that draws the same random numbers, as a whole and everywhere?

    As `verdicts.bias_verdict`, with the same tiles, levels, scales and correction for skewness, but for two things.
    Moments are those of the batches' differences; their variances too are borrowed from neighbours. And an interval
    about a mean that has seen one parting or none knows nothing of partings (it covers the truth in 40 to 60 % of
    cases, not in 95 %): `pass`, `low` and `high` therefore allow for what no sample has shown yet (`Contrast.unseen`:
    3.7 M/n at 95 %, for n samples of the tile, none larger than M). `fail` does not.

    `largest`: M, in radiance, a number or one a channel; see `largest_samples`, which says what is made of it. A
    tolerance is refused below `FLOAT32_FLOOR`: HarnessError, as for estimates that do not go in pairs, levels outside
    (0, 1), and a `largest` that is no radiance, or is needed and not there.
    """
    tolerance = tolerance or COUPLED
    check_paired_tolerance(tolerance)
    return judged(paired(test, reference, largest), test.tile, tolerance, fail_level=fail_level, pass_level=pass_level)


def paired(test: TileSamples, reference: TileSamples, largest: ArrayLike | None = None) -> Iterator[PairedContrast]:
    """Contrasts of the image, the larger and the smaller tiles of batches that go in pairs; HarnessError where they do
    not, or where nothing bounds a sample."""
    _check_paired(test, reference)
    sides = ((test.whole(), reference.whole()), (test.coarser(COARSER), reference.coarser(COARSER)), (test, reference))
    for pair, bound in zip(sides, largest_by_size(test, reference, largest), strict=True):
        yield PairedContrast.of(PairedMoments.of(*pair), bound)


def largest_by_size(test: TileSamples, reference: TileSamples,
                    largest: ArrayLike | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`largest_samples` of the image, the larger and the smaller tiles."""
    bound = largest_samples(test, reference, largest)
    return bound.max(axis=(0, 1), keepdims=True), grouped(bound[None], COARSER, np.maximum)[0], bound


def largest_samples(test: TileSamples, reference: TileSamples, largest: ArrayLike | None = None) -> np.ndarray:
    """M: what a single sample may change in a tile at the most, (rows, columns, C), in radiance.

    Radiance is not negative, so a pair of samples differs by no more than the larger of the two. Three things are known
    of that, and the smallest bound is taken that none of them contradicts:

    - a tile's `brightest`, the largest sum in a pixel of any of its batches, holds for every sample that was drawn,
      and after n of them fewer than -ln(α)/n of those to come are larger, with the confidence that `unseen` has. It is
      tight where bright samples are rare (a tile in shadow), and up to a batch's samples per pixel times too wide where
      all samples are alike;
    - `largest`, from single samples (`largest_sample`): tight, but of few, so that a rarer and brighter one may exist;
    - the largest difference that a tile's batch shows times its samples: a parting as large as that was seen, and where
      it is larger than `largest` it takes its place. A defect of all paths looks like one, and makes passing harder.

    HarnessError where neither `largest` nor `brightest` is there.
    """
    sums = [side.brightest.max(axis=0) for side in (test, reference) if side.brightest is not None]
    if len(sums) == 2:
        certain = np.maximum(*sums)
    elif largest is None:
        raise HarnessError("the largest radiance of a sample is not known; give `largest`, or batches with `brightest`")
    else:
        certain = np.full(test.means.shape[1:], np.inf)
    if largest is None:
        return certain
    _check_largest(largest)
    with np.errstate(invalid="ignore"):
        away = np.abs(test.means - reference.means) * test.samples[:, None, None, None] * test.pixels
    seen = np.nan_to_num(away, nan=0.0, posinf=0.0).max(axis=(0, 1, 2))
    return np.minimum(certain, np.maximum(np.asarray(largest, dtype=np.float64), seen))


def largest_sample(test: ArrayLike, reference: ArrayLike) -> tuple[float, ...]:
    """The largest radiance in each channel, for `largest`, of single samples of both: arrays (..., C) as
    `agreement.agreement_verdict` is given them, of whatever many samples.

    Of N samples without one larger, fewer than 3/N are larger at 95 % (the rule of three again): 10,000 or more, of all
    of the image, are a fair sight of its lamps. Values that are not finite are left out.
    """
    channels = np.asarray(test).shape[-1]
    both = np.concatenate([np.abs(np.asarray(side, dtype=np.float64)).reshape(-1, channels)
                           for side in (test, reference)])
    return tuple(float(value) for value in np.where(np.isfinite(both), both, 0.0).max(axis=0))


def check_paired_tolerance(tolerance: Tolerance) -> None:
    """HarnessError for a tolerance that float32 sums do not keep."""
    for name, allowed in (("mean", tolerance.mean), ("coarse", tolerance.coarse), ("fine", tolerance.fine)):
        if not allowed >= FLOAT32_FLOOR:
            raise HarnessError(f"a coupled tolerance of {allowed:g} ({name}) lies below {FLOAT32_FLOOR:g}, by which "
                               "float32 sums of samples alone differ; set it to that or more")


def _check_paired(test: TileSamples, reference: TileSamples) -> None:
    ours, theirs = ((side.tile, side.height, side.width, side.channels, side.samples.tolist())
                    for side in (test, reference))
    if ours != theirs or test.channels != len(CHANNELS):
        raise HarnessError("expected two estimates that go in pairs, with equal tiles, sizes, batches and "
                           f"{len(CHANNELS)} channels, found {_told(test)} and {_told(reference)}")
    if not test.samples.all():
        raise HarnessError("expected two estimates that go in pairs, found an exact one")


def _told(side: TileSamples) -> str:
    return (f"{len(side.samples)} batches, {side.samples.sum():g} samples per pixel, of {side.width} x {side.height} "
            f"pixels in tiles of {side.tile}, {side.channels} channels")


def _check_largest(largest: ArrayLike) -> None:
    values = np.atleast_1d(np.asarray(largest, dtype=np.float64))
    if values.shape not in {(1,), (len(CHANNELS),)} or not all(math.isfinite(value) and value >= 0 for value in values):
        raise HarnessError(f"the largest sample must be a radiance of zero or more, or one for each of {len(CHANNELS)} "
                           f"channels, found {values.tolist()}")
