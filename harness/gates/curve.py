"""A gate's error as its samples grow: prefixes of the run, for the curve that a gate leaves behind."""

from __future__ import annotations

import numpy as np

from harness.gates.budget import tile_scale
from harness.gates.model import CurvePoint, Gate
from harness.stats.channels import Channel
from harness.stats.contrasts import Contrast, IndependentContrast
from harness.stats.paired import paired
from harness.stats.tiles import TileSamples
from harness.work.run import FixedRun, Run


def curve(gate: Gate, ours: Run, theirs: Run | FixedRun) -> tuple[CurvePoint, ...]:
    """Prefixes of 1, 2, 4, … replicas, and all; against all of the reference or, of a coupled gate, its same prefix."""
    counts = sorted({*(2**k for k in range(ours.replicas.bit_length())), ours.replicas})
    return tuple(_point(gate, ours.tiles(count), theirs.tiles(count if gate.paired else ours.replicas),
                        gate.spp * count) for count in counts)


def _point(gate: Gate, test: TileSamples, reference: TileSamples, samples: int) -> CurvePoint:
    """See `CurvePoint`. In pairs, what noise both sides have in common is in neither error."""
    whole: Contrast = (next(paired(test, reference)) if gate.paired
                       else IndependentContrast.of(test.whole().moments(), reference.whole().moments()))
    error = whole.excess(0.0).value / whole.scale
    told, low, high = (float(values[0, 0, Channel.LUMINANCE])
                       for values in (error, *whole.interval(gate.pass_level)))
    theirs = reference.moments()
    squares = (test.moments().mean - theirs.mean)**2 - (0.0 if gate.paired else theirs.variance)
    square = float((squares / tile_scale(theirs)**2)[..., Channel.LUMINANCE].mean())
    return CurvePoint(samples, told, low, high, float(np.sqrt(max(square, 0.0))))
