"""Is a render biased against a reference that draws the same random numbers? The verdict on differences.

Batch k of the test and batch k of the reference follow the same paths up to rounding, so their difference has a
variance 10^3 to 10^14 times smaller than either, and tails as heavy as can be: one sample in a million parts from its
twin, and is then off by as much as a sample is. The mean of the differences is the difference of the means whether
paths part or not, so none is left out: a defect may sit in those that part alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from harness.errors import HarnessError
from harness.stats.bias import Outcome
from harness.stats.channels import CHANNELS
from harness.stats.contrasts import PairedContrast, PairedMoments
from harness.stats.deviates import critical_deviate
from harness.stats.levels import Looks
from harness.stats.needed import factor_to_decide
from harness.stats.tiles import COARSER, TileSamples, grouped
from harness.stats.verdicts import PASS_LEVEL, BiasVerdict, Tolerance, contrast_outcome, judged

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

    Looks share `pass_level` for their intervals, and each has all of it for what no sample has shown yet
    (`PairedContrast.unseen`). HarnessError for tolerances below `FLOAT32_FLOOR`.
    """

    looks: Looks
    tolerance: Tolerance = field(default_factory=lambda: COUPLED)
    fail_level: float = 0.01
    pass_level: float = PASS_LEVEL

    def __post_init__(self) -> None:
        check_paired_tolerance(self.tolerance)

    def decide(self, look: int, test: TileSamples, reference: TileSamples) -> BiasVerdict:
        """The verdict at look number `look`, from 0; final unless it is inconclusive and a look is left."""
        return paired_verdict(test, reference, self.tolerance, fail_level=self._fail_level(look),
                              pass_level=self._pass_level(look), unseen_level=self.pass_level)

    def outcome(self, look: int, test: TileSamples, reference: TileSamples) -> Outcome:
        """That of `decide`, without the rest of the verdict."""
        return self.outcome_of(look, paired(test, reference, self.pass_level))

    def outcome_of(self, look: int, contrasts: Iterable[PairedContrast]) -> Outcome:
        """The same from what `paired` made of them at `pass_level`."""
        return contrast_outcome(contrasts, self.tolerance, fail_level=self._fail_level(look),
                                pass_level=self._pass_level(look))

    def factor_needed(self, test: TileSamples, reference: TileSamples) -> float:
        """How many times these samples decide at the last look with probability 0.95, if there is no bias.

        From the variance seen so far, never from the error. It knows nothing of partings that have not come, but what
        `pass` allows for them: of a first look without any it is a lower bound, of one with many an estimate.
        """
        level = self._pass_level(len(self.looks.samples) - 1)
        ratios, unseen = self._in_tolerances(paired(test, reference, self.pass_level), level)
        return factor_to_decide(ratios, critical_deviate(level / 2), unseen)

    def too_small(self, look: int, test: TileSamples, reference: TileSamples) -> float | None:
        """Does a look show that the budget cannot decide? Then how many times the budget would be the least; or None.

        It does where what has not come yet may alone be more than a tolerance at the budget: this falls as samples
        come and depends on no chance. Nothing is concluded from the variance: one early parting makes it many times
        too large, and the next look may be without another.
        """
        return self.too_small_of(look, paired(test, reference, self.pass_level))

    def too_small_of(self, look: int, contrasts: Iterable[PairedContrast]) -> float | None:
        """The same from what `paired` made of them at `pass_level`."""
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
                   fail_level: float = 0.01, pass_level: float = PASS_LEVEL,
                   unseen_level: float | None = None) -> BiasVerdict:
    """Is the test equivalent to a reference that draws the same random numbers, as a whole and everywhere?

    As `verdicts.bias_verdict`, with the same tiles, levels, scales and correction for skewness, but for two things.
    Moments are those of the batches' differences; their variances too are borrowed from neighbours. And an interval
    about a mean that has seen one parting or none knows nothing of partings (it covers the truth in 40 to 60 % of
    cases, not in 95 %): `pass`, `low` and `high` therefore allow for what no sample has shown yet (`Contrast.unseen`:
    3.7 M/n at 95 %, for n samples of the tile, none larger than M, see `largest_samples`). `fail` does not.

    `unseen_level`: that of all looks, where this is one of several (`PairedContrast.unseen`). A tolerance is refused
    below `FLOAT32_FLOOR`: HarnessError, as for estimates that do not go in pairs, levels outside (0, 1), and a
    reference without `brightest`.
    """
    tolerance = tolerance or COUPLED
    check_paired_tolerance(tolerance)
    return judged(paired(test, reference, unseen_level), test.tile, tolerance, fail_level=fail_level,
                  pass_level=pass_level)


def paired(test: TileSamples, reference: TileSamples, unseen_level: float | None = None) -> Iterator[PairedContrast]:
    """Contrasts of the image, the larger and the smaller tiles of batches that go in pairs; HarnessError where they do
    not, or where nothing bounds a sample."""
    _check_paired(test, reference)
    sides = ((test.whole(), reference.whole()), (test.coarser(COARSER), reference.coarser(COARSER)), (test, reference))
    for pair, bound in zip(sides, largest_by_size(test, reference), strict=True):
        yield PairedContrast.of(PairedMoments.of(*pair), bound, unseen_level)


def largest_by_size(test: TileSamples, reference: TileSamples) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`largest_samples` of the image, the larger and the smaller tiles."""
    bound = largest_samples(test, reference)
    return bound.max(axis=(0, 1), keepdims=True), grouped(bound[None], COARSER, np.maximum)[0], bound


def largest_samples(test: TileSamples, reference: TileSamples) -> np.ndarray:
    """M: what a single sample may change in a tile at the most, (rows, columns, C), in radiance.

    Radiance is not negative, so a pair of samples differs by no more than the larger of the two. Of a pair that goes
    together both are about as large as the reference's, of which `brightest` knows the largest of all that were drawn
    in the tile. Of one that parted the difference was seen: it is no larger than the largest that a batch of the tile
    shows, times its samples (where several partings of a batch add up, that is more than one of them; a defect of all
    paths looks like a large one, and makes passing harder). M is the larger of the two.

    A tile has its own M, since the light of a dark corner is seldom as bright as that of a lamp elsewhere: of n samples
    drawn in it none exceeded M, so of those to come fewer than -ln(α)/n do, with the confidence that `unseen` has. By
    how much they do is not bounded by that, but on average it is little: the expected excess of one more sample over
    the largest of n is what the largest would still grow by, M ξ/n for a tail of index ξ (ξ < 1 where there is a mean),
    beside the 3.7 M/n that are allowed. HarnessError where the reference's `brightest` is not known.
    """
    if reference.brightest is None:
        raise HarnessError("the largest sample of the reference is not known; give batches with `brightest`")
    with np.errstate(invalid="ignore"):
        away = np.abs(test.means - reference.means) * test.samples[:, None, None, None] * test.pixels
    seen = np.nan_to_num(away, nan=0.0, posinf=0.0).max(axis=0)
    return np.maximum(reference.brightest.max(axis=0), seen)


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
