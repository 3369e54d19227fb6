"""What the tiles of an image say, in few numbers: verdicts on two sizes, and the tile that is furthest off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.stats.bias import Outcome
from harness.stats.channels import CHANNELS, Channel
from harness.stats.deviates import critical_deviate
from harness.stats.needed import factor_to_decide, times
from harness.stats.tiles import COARSER, TileSamples
from harness.stats.verdicts import TileVerdict, Tolerance, tile_verdict

# Relative differences that float32 arithmetic leaves between two exact answers: no deviate is made of them.
ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class TileFinding:
    """The tiles of one size, `tile` pixels a side; `outcome` to `p` and `critical` as in `stats.verdicts.TileVerdict`.

    `z`: (rows, columns), each tile's error over its standard error, as a normal deviate, in the channel where it is
    largest; zero where the error is rounding. The `worst` tile is the one with the largest |z|: `x`, `y` are its first
    pixel, `channel`, `error`, `low`, `high` its channel of that z. `detectable`: the smallest bias of luminance that
    was sure (probability 0.95) to make a tile fail, in the median tile and in that where it is hardest to see.
    `needed`: how many times the samples, of both sides, would let an unbiased render pass with probability 0.95.
    """

    outcome: Outcome
    reason: str
    tolerance: float
    fail_level: float
    pass_level: float
    tile: int
    z: np.ndarray
    critical: float
    p: float
    x: int
    y: int
    channel: str
    error: float
    low: float
    high: float
    detectable: tuple[float, float]
    needed: float

    @property
    def told(self) -> str:
        """The reason, and where samples are wanted how many."""
        if self.outcome != "inconclusive" or not np.isfinite(self.needed):
            return self.reason
        return f"{self.reason}, {times(self.needed)} as many"


@dataclass(frozen=True, eq=False)
class Tiles:
    """The larger tiles and the smaller ones."""

    coarse: TileFinding
    fine: TileFinding

    @property
    def failed(self) -> bool:
        """True where a tile of either size is off by more than its tolerance."""
        return "fail" in (self.coarse.outcome, self.fine.outcome)


def judge_tiles(test: TileSamples, reference: TileSamples, tolerance: Tolerance, *, fail_level: float,
                pass_level: float) -> Tiles:
    """The verdicts on the larger and the smaller tiles; `fail_level` is that of each of the two.

    The tiles of both estimates are the smaller ones, with four channels. Raises as `stats.verdicts.tile_verdict`.
    """
    coarse, fine = (summarised(tile_verdict(ours, theirs, allowed, fail_level=fail_level, pass_level=pass_level))
                    for ours, theirs, allowed in (
                        (test.coarser(COARSER), reference.coarser(COARSER), tolerance.coarse),
                        (test, reference, tolerance.fine)))
    return Tiles(coarse, fine)


def summarised(verdict: TileVerdict) -> TileFinding:
    """The few numbers of a verdict that a reader needs."""
    z = np.where(np.abs(verdict.error) <= ROUNDING, 0.0, verdict.z)
    size = np.abs(np.nan_to_num(z))
    row, column, channel = (int(i) for i in np.unravel_index(int(np.argmax(size)), z.shape))
    at = row, column, channel
    hardest = verdict.tolerance + verdict.smallest_detectable[..., Channel.LUMINANCE]
    return TileFinding(
        outcome=verdict.outcome, reason=verdict.reason, tolerance=verdict.tolerance, fail_level=verdict.fail_level,
        pass_level=verdict.pass_level, tile=verdict.tile, z=largest_deviates(z), critical=verdict.critical, p=verdict.p,
        x=column * verdict.tile, y=row * verdict.tile, channel=CHANNELS[channel], error=float(verdict.error[at]),
        low=float(verdict.low[at]), high=float(verdict.high[at]),
        detectable=(float(np.median(hardest)), float(np.max(hardest))), needed=_needed(verdict))


def largest_deviates(z: np.ndarray) -> np.ndarray:
    """Of each tile's deviates (rows, columns, C) the one furthest from zero, with its sign, (rows, columns)."""
    channel = np.abs(np.nan_to_num(z)).argmax(axis=-1)[..., None]
    return np.asarray(np.take_along_axis(z, channel, axis=-1)[..., 0])


def _needed(verdict: TileVerdict) -> float:
    sure = critical_deviate(verdict.pass_level / 2)
    with np.errstate(divide="ignore", invalid="ignore"):  # a tolerance of zero takes samples without end
        ratios = (verdict.high - verdict.low) / (2 * sure * verdict.tolerance)
    return factor_to_decide(ratios, sure)
